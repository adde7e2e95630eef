"""``armgate conformance``."""

import stat
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import ssl

    from armgate.conformance.kit import Options


_OWNERS = ("operator", "controller", "observer", "elsewhere")


class UsageError(Exception):
    """The kit was called wrongly."""

    exit_code = 2


def conformance(
    address: Annotated[str | None, typer.Argument(metavar="[HOST:PORT]", help="The server to try.")] = None,
    *,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="COMMAND", help="Start this server instead; its first line must end with HOST:PORT."
        ),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Count a SHOULD that is not kept as failed.")
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Only this case, statement or topic (LEA-8/takeover, LEA-8, LEA); may be repeated.",
        ),
    ] = None,
    robot: Annotated[str | None, typer.Option(help="The robot to move; default: the first.")] = None,
    participants: Annotated[
        str, typer.Option(metavar="A,B", help="Two participants of a server in lock-step.")
    ] = "",
    token_file: Annotated[
        Path | None, typer.Option(help="Lines `ROLE TOKEN`; ROLE: operator, controller, observer, elsewhere.")
    ] = None,
    tls_ca: Annotated[Path | None, typer.Option(help="Use TLS; the certificate to trust.")] = None,
    tls_cert: Annotated[
        Path | None, typer.Option(help="The kit's own certificate, for a server that asks for one.")
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Its key.")] = None,
    faults: Annotated[
        str, typer.Option(metavar="LIST", help="Faults on the way, such as latency=80ms,jitter=40ms,slice=7.")
    ] = "",
    seed: Annotated[int, typer.Option(help="Of what --faults leaves to chance.")] = 1,
    junit: Annotated[Path | None, typer.Option(metavar="FILE", help="Write JUnit XML.")] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one self-contained HTML page.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write report.html, junit.xml and a wire log for each failure."),
    ] = None,
    list_: Annotated[bool, typer.Option("--list", help="List the cases and try none.")] = False,
) -> None:
    """Try whether a server keeps the specification of the protocol. It moves robots: not for real ones.

    Two verdicts: safety (did a robot do what it must not?) and session (did the conversation go as written?).
    Exit status: 0 all passed, 1 some failed, 2 called wrongly, no server there, or nothing could be tried.
    """
    import asyncio

    from armgate.conformance.case import selected
    from armgate.conformance.faults import Faults
    from armgate.conformance.kit import Options, listing, run

    try:
        chosen = selected(only or [])
    except LookupError as error:
        raise UsageError(str(error.args[0])) from error
    if list_:
        typer.echo(listing(chosen))
        return
    if (address is None) == (start is None):
        raise UsageError("give either HOST:PORT or --start COMMAND")
    options = Options(
        address=None if address is None else _address(address),
        start=start,
        cases=chosen,
        strict=strict,
        robot=robot,
        participants=tuple(filter(None, (name.strip() for name in participants.split(",")))),
        tokens={} if token_file is None else _tokens(token_file),
        tls=_tls(tls_ca, tls_cert, tls_key),
        faults=Faults.parse(faults),
        seed=seed,
    )
    _files(options, junit, html, out)
    raise typer.Exit(asyncio.run(run(options, typer.echo)))


def _files(options: "Options", junit: Path | None, html: Path | None, out: Path | None) -> None:
    options.junit, options.html = junit, html
    if out is not None:
        (out / "wire").mkdir(parents=True, exist_ok=True)
        options.junit = junit or out / "junit.xml"
        options.html = html or out / "report.html"
        options.wires = out / "wire"
    for file in filter(None, (options.junit, options.html)):
        if not file.resolve().parent.is_dir():
            raise UsageError(f"{file}: there is no folder {file.resolve().parent}")


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(f"{text!r} is no address; write HOST:PORT, such as 127.0.0.1:7411")
    return host.strip("[]"), int(port)


def _tls(authority: Path | None, certificate: Path | None, key: Path | None) -> "ssl.SSLContext | None":
    import ssl

    if (certificate is None) is not (key is None) or (certificate is not None and authority is None):
        raise UsageError("--tls-cert and --tls-key go together, and with --tls-ca")
    if authority is None:
        return None
    given = authority
    try:
        context = ssl.create_default_context(cafile=str(authority))
        if certificate is not None and key is not None:
            given = certificate
            context.load_cert_chain(certificate, key)
    except OSError as error:
        raise UsageError(f"{given}: {error.strerror or error}; expected a file in PEM") from error
    return context


def _tokens(file: Path) -> dict[str, str]:
    """Tokens by role; a line with a token alone is an operator's."""
    found: dict[str, str] = {}
    try:
        if file.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            text = "other users of this machine can read these secrets"
            raise UsageError(f"--token-file {file}: {text}; run: chmod 600 {file}")
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--token-file {file}: {error}; expected lines `ROLE TOKEN`") from error
    for number, text in enumerate(lines, start=1):
        words = text.split()
        if not words or text.startswith("#"):
            continue
        role, token = words if len(words) == 2 else ("operator", words[0])
        if len(words) > 2 or role not in _OWNERS:
            raise UsageError(f"{file}:{number}: expected ROLE TOKEN, with ROLE one of {', '.join(_OWNERS)}")
        found[role] = token
    return found

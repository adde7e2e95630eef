"""``armgate monitor``: a second judge of a running cell, or of a recording."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login

if TYPE_CHECKING:
    from armgate.monitor.core import Account

SILENCE = 1.0
"""Default of ``--silence``, s; as in ``tolerances``, which is not loaded for the help."""


def monitor(
    source: Annotated[
        str,
        typer.Argument(
            metavar="HOST:PORT|unix:PATH|RUN",
            help="The address or Unix socket of the daemon; or a recording: the folder of the run, "
            "or one of its files.",
        ),
    ],
    config: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Configuration of the cell; later files overlay earlier ones. Required for a daemon; "
            "by default a recording is judged by the configuration in it.",
            show_default=False,
        ),
    ] = None,
    *,
    silence: Annotated[
        float,
        typer.Option(min=0.05, metavar="S", help="Stop the cell if a robot sends no state for S seconds."),
    ] = SILENCE,
    json_: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write what was checked and found.", show_default=False),
    ] = None,
    name: Annotated[str, typer.Option(help="Name of this client.")] = "monitor",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Check every state with kinematics and distances of its own; stop the cell if a rule is broken.

    Exit status: 0 if nothing was violated, 1 if something was or the connection was lost, 2 for wrong use.
    """
    from armgate.monitor.errors import DescriptionError

    configs = tuple(config or ())
    if recorded(source):
        from armgate.monitor.audit import audit

        if not Path(source).exists():
            raise DescriptionError(f"{source}: neither HOST:PORT, unix:PATH nor a recording")
        _, account = audit(Path(source), configs, silence)
        _end(account, json_)
        return
    if not configs:
        raise DescriptionError("no configuration given; a daemon is judged by a configuration: CONFIG…")
    _watch(source, configs, silence, json_, name, login(token_file, ca, cert, key))


def _watch(  # type: ignore[no-untyped-def]
    address: str, configs: tuple[Path, ...], silence: float, json_: Path | None, name: str, own
) -> None:
    from armgate.client import connect
    from armgate.monitor.live import Watch, asked_to_end
    from armgate.monitor.report import printable

    def tell(text: str) -> None:
        typer.echo(f"armgate: monitor: {printable(text)}")

    with connect(address, name=name, role="observer", **own) as cell, asked_to_end() as ended:
        watch = Watch(cell, configs, silence, tell)
        try:
            watch.run(ended)
        finally:
            _write(watch.account, json_)
    _end(watch.account, None)


def _end(account: "Account", json_: Path | None) -> None:
    from armgate.monitor.report import lines, printable

    _write(account, json_)
    for line in lines(account):
        typer.echo(f"armgate: monitor: {printable(line)}")
    raise typer.Exit(1 if account.violations else 0)


def _write(account: "Account", json_: Path | None) -> None:
    import json

    from armgate.monitor.report import as_json

    if json_ is not None:
        json_.write_text(json.dumps(as_json(account), indent=2) + "\n", encoding="utf-8")


def recorded(source: str) -> bool:
    """Return True if a recording is meant, by its path, and not an address."""
    if source.startswith("unix:"):
        return False
    return Path(source).exists() or re.search(r":\d+$", source) is None

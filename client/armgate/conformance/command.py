"""``armgate conformance``."""

from pathlib import Path
from typing import Annotated

import typer

Address = Annotated[str | None, typer.Argument(metavar="HOST:PORT", help="Address of the server to test.")]
Start = Annotated[
    str | None,
    typer.Option(
        metavar="COMMAND", help="Start this server instead; its first line must end with HOST:PORT."
    ),
]
Strict = Annotated[bool, typer.Option("--strict", help="Count a violated SHOULD as failed.")]
Only = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ID",
        help="Run only this case, statement or topic (LEA-8/takeover, LEA-8, LEA); repeat to combine.",
    ),
]
Robot = Annotated[str | None, typer.Option(help="Robot to move; default: the first.")]
Participants = Annotated[
    str, typer.Option(metavar="A,B", help="Names of two participants of a server in lock-step.")
]
TokenFile = Annotated[
    Path | None,
    typer.Option(
        help="File with one token per line: `ROLE TOKEN`. ROLE is operator, controller, observer, or "
        "elsewhere: a token that allows only other robots."
    ),
]
Ca = Annotated[Path | None, typer.Option(help="Use TLS, and trust this certificate.")]
Cert = Annotated[
    Path | None, typer.Option(help="Certificate of the kit, for a server that requires client certificates.")
]
Key = Annotated[Path | None, typer.Option(help="Private key of the kit's certificate.")]
FaultList = Annotated[
    str,
    typer.Option(metavar="LIST", help="Network faults to inject, such as latency=80ms,jitter=40ms,slice=7."),
]
Seed = Annotated[int, typer.Option(help="Seed of the random numbers of --faults.")]
Junit = Annotated[Path | None, typer.Option(metavar="FILE", help="Write JUnit XML.")]
Html = Annotated[Path | None, typer.Option(metavar="FILE", help="Write one self-contained HTML page.")]
Out = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Write report.html, junit.xml and a wire log for each failure."),
]
ListCases = Annotated[bool, typer.Option("--list", help="List the cases and exit.")]


def conformance(
    address: Address = None,
    *,
    start: Start = None,
    strict: Strict = False,
    only: Only = None,
    robot: Robot = None,
    participants: Participants = "",
    token_file: TokenFile = None,
    tls_ca: Ca = None,
    tls_cert: Cert = None,
    tls_key: Key = None,
    faults: FaultList = "",
    seed: Seed = 1,
    junit: Junit = None,
    html: Html = None,
    out: Out = None,
    list_: ListCases = False,
) -> None:
    """Test whether a server conforms to the protocol's specification. It moves robots: never use real ones.

    Each case has two outcomes: safety (no robot made a forbidden motion) and session (the conversation
    followed the specification).
    Exit status: 0 all passed, 1 some failed, 2 wrong use, no server, or no case could be run.
    """
    import asyncio

    from armgate.conformance import options as parse
    from armgate.conformance.fault_injection import Faults
    from armgate.conformance.run import list_cases, run

    cases = parse.chosen_cases(only or [])
    if list_:
        typer.echo(list_cases(cases))
        return
    options = parse.Options(
        parse.server_address(address, start), start, cases, strict=strict, robot=robot,
        participants=parse.names(participants), tokens=parse.tokens_of(token_file),
        tls=parse.tls_context(tls_ca, tls_cert, tls_key), faults=Faults.parse(faults), seed=seed,
    )  # fmt: skip
    options.set_reports(junit, html, out)
    raise typer.Exit(asyncio.run(run(options, typer.echo)))

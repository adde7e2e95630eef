"""``armgate krc``: run a virtual KRC as a process."""

from pathlib import Path
from typing import Annotated

import typer

Profile = Annotated[str, typer.Option(help="krc2-rsi2, krc4-rsi3 or krc5-rsi5.")]
Config = Annotated[Path, typer.Option(metavar="FILE.xml", help="RSI Ethernet file of the KRC.")]
To = Annotated[
    str | None, typer.Option(metavar="HOST:PORT", help="Address of the PC.", show_default="as in the file")
]
Port = Annotated[
    int, typer.Option(min=0, max=65535, help="UDP port of this KRC; 0 selects a free port for each run.")
]
Robot = Annotated[str, typer.Option(help="kr16, a URDF file, or a robot of --cell.")]
Cell = Annotated[list[Path] | None, typer.Option(help="Configuration files of the cell.")]
Start = Annotated[
    str | None, typer.Option(metavar="A1,A2,…", help="Initial position, deg and mm: A axes, then E axes.")
]
Cycle = Annotated[float | None, typer.Option(metavar="MS", help="Cycle, ms; 12 for #IPO on KRC4 and later.")]
Lag = Annotated[
    str | None,
    typer.Option(
        metavar="MS",
        help="Lag of the measured position: 30, or A1=33,A2=27.",
        show_default="that of the profile",
    ),
]
RsiMode = Annotated[str, typer.Option(help="Mode of RSI_ON: absolute or relative.")]
Aspos = Annotated[
    str, typer.Option(help="Programmed position (ASPos, RSol) under correction: stands or moves.")
]
Precision = Annotated[int, typer.Option(min=0, max=9, help="Decimals in telegrams.")]
Timeout = Annotated[int, typer.Option(min=0, help="Tolerated number of late cycles.")]
Axiscorr = Annotated[
    str,
    typer.Option(help="Limit of corrections, deg or mm: one number, or one for each group (A=170,E=2000)."),
]
Axiscorrmon = Annotated[str, typer.Option(help="Correction beyond which RSI stops, deg or mm.")]
FirstIpoc = Annotated[int | None, typer.Option(min=0, help="First IPOC.", show_default="random, by the seed")]
Seed = Annotated[int, typer.Option(help="Seed of all random numbers.")]
Loss = Annotated[str, typer.Option(metavar="P", help="Share of lost datagrams, or to-pc=P,to-krc=P.")]
Duplicate = Annotated[
    str, typer.Option(metavar="P", help="Share of datagrams that arrive twice, or to-pc=P,to-krc=P.")
]
Reorder = Annotated[
    str,
    typer.Option(metavar="P", help="Share of datagrams that arrive after the next, or to-pc=P,to-krc=P."),
]
Delay = Annotated[str, typer.Option(metavar="MS", help="Delay of all datagrams, ms, or to-pc=MS,to-krc=MS.")]
Jitter = Annotated[
    str, typer.Option(metavar="MS", help="Largest additional delay, ms, or to-pc=MS,to-krc=MS.")
]
Stopped = Annotated[bool, typer.Option("--stopped", help="Wait for the command 'start' on stdin.")]
LogFile = Annotated[Path | None, typer.Option(help="File for the log.", show_default="stderr")]
TraceFile = Annotated[
    Path | None, typer.Option(metavar="FILE.csv", help="File for the setpoint of every cycle.")
]


def krc(
    *,
    profile: Profile,
    config: Config,
    to: To = None,
    port: Port = 0,
    robot: Robot = "kr16",
    cell: Cell = None,
    start: Start = None,
    cycle: Cycle = None,
    lag: Lag = None,
    mode: RsiMode = "absolute",
    aspos: Aspos = "stands",
    precision: Precision = 1,
    timeout: Timeout = 10,
    axiscorr: Axiscorr = "5",
    axiscorrmon: Axiscorrmon = "6",
    ipoc: FirstIpoc = None,
    seed: Seed = 0,
    loss: Loss = "0",
    duplicate: Duplicate = "0",
    reorder: Reorder = "0",
    delay: Delay = "0",
    jitter: Jitter = "0",
    stopped: Stopped = False,
    log: LogFile = None,
    trace: TraceFile = None,
) -> None:
    """Run a virtual KUKA controller that exchanges RSI telegrams with a PC, until SIGTERM or Ctrl-C."""
    import asyncio

    from armgate.emulator.krc.process import options
    from armgate.emulator.krc.process.serve import serve

    ethernet = options.load_ethernet(config)
    given = options.Options(
        profile=options.select_profile(profile, cycle, lag),
        ethernet=ethernet,
        context=options.parse_context(mode, precision, timeout, axiscorr, axiscorrmon, aspos),
        arm=options.load_arm(robot, cell or [], start),
        peer=options.parse_peer(to, ethernet),
        network=options.parse_network(
            loss=loss, duplicate=duplicate, reorder=reorder, delay=delay, jitter=jitter
        ),
        seed=seed,
        ipoc=ipoc,
        port=port,
        stopped=stopped,
    )
    asyncio.run(serve(given, log, trace))

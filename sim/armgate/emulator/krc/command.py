"""``armgate krc``: a virtual KRC as a process of its own."""

from pathlib import Path
from typing import Annotated

import typer

Rate = Annotated[str, typer.Option(metavar="P", help="Share of datagrams, or to-pc=P,to-krc=P.")]
Time = Annotated[str, typer.Option(metavar="MS", help="Milliseconds, or to-pc=MS,to-krc=MS.")]


def krc(
    *,
    profile: Annotated[str, typer.Option(help="krc2-rsi2, krc4-rsi3 or krc5-rsi5.")],
    config: Annotated[Path, typer.Option(metavar="FILE.xml", help="The KRC's RSI Ethernet file.")],
    to: Annotated[
        str | None, typer.Option(metavar="HOST:PORT", help="The PC; else as the file says.")
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Of this KRC, for all its runs; 0: another one for each.")
    ] = 0,
    robot: Annotated[str, typer.Option(help="kr16, a URDF file, or a robot of --cell.")] = "kr16",
    cell: Annotated[list[Path] | None, typer.Option(help="Cell files in which --robot stands.")] = None,
    start: Annotated[
        str | None, typer.Option(metavar="A1,A2,…", help="Where it stands, deg and mm: A axes, then E axes.")
    ] = None,
    cycle: Annotated[float | None, typer.Option(metavar="MS", help="12 for #IPO on KRC4 and later.")] = None,
    lag: Annotated[
        str | None,
        typer.Option(
            metavar="MS", help="Lag of the measured position: 30, or A1=33,A2=27; else the profile's."
        ),
    ] = None,
    mode: Annotated[str, typer.Option(help="absolute or relative.")] = "absolute",
    aspos: Annotated[
        str, typer.Option(help="stands or moves: what ASPos and RSol do while the robot is corrected.")
    ] = "stands",
    precision: Annotated[int, typer.Option(min=0, max=9, help="Decimals in telegrams.")] = 1,
    timeout: Annotated[int, typer.Option(min=0, help="Late cycles that are borne.")] = 10,
    axiscorr: Annotated[str, typer.Option(help="Correction beyond which is cut: 5, or A=170,E=2000.")] = "5",
    axiscorrmon: Annotated[str, typer.Option(help="Correction beyond which RSI stops.")] = "6",
    ipoc: Annotated[int | None, typer.Option(min=0, help="The first IPOC; else any, by the seed.")] = None,
    seed: Annotated[int, typer.Option(help="Of all that happens by chance.")] = 0,
    loss: Rate = "0",
    duplicate: Rate = "0",
    reorder: Rate = "0",
    delay: Time = "0",
    jitter: Time = "0",
    stopped: Annotated[bool, typer.Option("--stopped", help="Wait for the command start.")] = False,
    log: Annotated[Path | None, typer.Option(help="File for the log; else stderr.")] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="File for the setpoint of every cycle.")
    ] = None,
) -> None:
    """Run a virtual KUKA controller that speaks RSI to a PC, until SIGTERM or Ctrl-C."""
    import asyncio

    from armgate.emulator.krc import setup
    from armgate.emulator.krc.process import serve

    ethernet = setup.ethernet_of(config)
    kind = setup.profile_of(profile, cycle, lag)
    options = setup.Setup(
        profile=kind,
        ethernet=ethernet,
        context=setup.context_of(mode, precision, timeout, axiscorr, axiscorrmon, aspos),
        arm=setup.arm_of(robot, cell or [], start),
        peer=setup.peer_of(to, ethernet),
        network=setup.network_of(loss=loss, duplicate=duplicate, reorder=reorder, delay=delay, jitter=jitter),
        seed=seed,
        ipoc=ipoc,
        port=port,
        stopped=stopped,
    )
    asyncio.run(serve(options, log, trace))

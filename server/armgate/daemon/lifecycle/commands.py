"""``armgate serve`` and ``armgate check``."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgate.cell.errors import install_hint

if TYPE_CHECKING:
    from armgate.cell.cell import Cell
    from armgate.cell.config import CellConfig
    from armgate.daemon.auth.keys import Keys
    from armgate.links.log import Log

_FAULTS_LOGGED = 16
"""Number of faults of the start position that are logged."""

_EXTRA = ("pinocchio", "coal", "fcl", "mcap", "prometheus_client")
"""Modules of the extra ``cell``."""

Configs = Annotated[
    list[Path],
    typer.Argument(metavar="CONFIG", help="Configuration files; later ones overlay earlier ones."),
]
_Host = Annotated[
    str | None, typer.Option(help="Address to listen on; beyond loopback only with TLS and tokens.")
]
_Port = Annotated[
    int | None, typer.Option(min=0, max=65535, help="Port to listen on; 0 selects a free port.")
]
_Lockstep = Annotated[
    str | None, typer.Option(metavar="NAMES", help="Run in lock-step with the participants A,B,…")
]
_Record = Annotated[Path | None, typer.Option(metavar="DIR", help="Record the run into this folder.")]
_RobotServer = Annotated[
    Path | None, typer.Option(metavar="PATH", help="Socket of the robot server that runs the links.")
]
_RequireLogin = Annotated[
    bool, typer.Option("--require-login", help="Refuse to start without tokens or a Unix socket.")
]


class ServeError(Exception):
    """Options with which the daemon cannot start; no robot was moved."""

    exit_code = 2


def serve(
    configs: Configs,
    host: _Host = None,
    port: _Port = None,
    lockstep: _Lockstep = None,
    record: _Record = None,
    robot_server: _RobotServer = None,
    require_login: _RequireLogin = False,
) -> None:
    """Serve a cell to clients until SIGTERM or Ctrl-C.

    On SIGHUP, reload tokens and certificates.
    """
    from armgate.cell.config import load_config
    from armgate.daemon.auth.keys import load_keys

    config = _overridden(load_config(configs), host, port, lockstep)
    keys = load_keys(config, login_required=require_login)
    cell = _built(config)
    raise typer.Exit(_serve(cell, keys, record, _robot_server(cell, robot_server)))


def check(configs: Configs) -> None:
    """Check a configuration: robots, joints, limits, pairs, clearances at the start position."""
    from armgate.cell.config import load_config

    cell = _built(load_config(configs))
    with _extra_needed():
        from armgate.daemon.lifecycle.check import report
    raise typer.Exit(report(cell))


def _overridden(
    config: "CellConfig", host: str | None, port: int | None, lockstep: str | None
) -> "CellConfig":
    server = {"host": config.server.host if host is None else host}
    settings = config.server.model_copy(update=server | ({} if port is None else {"port": port}))
    changed = config.model_copy(update={"server": settings})
    return changed if lockstep is None else _in_lockstep(changed, lockstep)


def _in_lockstep(config: "CellConfig", names: str) -> "CellConfig":
    from armgate.cell.config import in_lockstep

    try:
        return in_lockstep(config, [name.strip() for name in names.split(",")])
    except ValueError as error:
        text = f"--lockstep {names!r}: expected the participants' names, each once, separated by commas"
        raise ServeError(text) from error


@contextmanager
def _extra_needed() -> Iterator[None]:
    """Report a missing module of the extra ``cell`` as an incomplete installation, with the remedy."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _EXTRA:
            raise
        text = f"{error.name} is not installed, but the daemon needs it; run {install_hint('cell')}"
        raise ServeError(text) from error


def _built(config: "CellConfig") -> "Cell":
    with _extra_needed():
        from armgate.cell.cell import build_cell

        return build_cell(config)


def _robot_server(cell: "Cell", given: Path | None) -> Path | None:
    """Return the socket of the robot server, or None if the robots are emulated in this process.

    The robots are in a robot server if its socket is given, or if a robot is not emulated.
    """
    from armgate.links.kind import needs_robot_server
    from armgate.links.robot_server.command import robot_server_path

    if not needs_robot_server(cell) and given is None and cell.config.server.robot_server is None:
        return None
    if cell.config.clock.kind == "lockstep":
        raise ServeError("robots of a robot server have their own clocks and cannot run in lock-step")
    return given or robot_server_path(cell)


def _serve(cell: "Cell", keys: "Keys", record: Path | None, robot_server: Path | None) -> int:
    import asyncio

    from armgate.cell.compilation import announced
    from armgate.daemon.auth.reloading import warn_of_unknown_robots
    from armgate.links.log import Log

    with _extra_needed():
        from armgate.daemon.lifecycle.daemon import Daemon
        from armgate.daemon.recording.start import recorder_of
        from armgate.gate import Gate, prepare

    log = Log(sys.stderr)
    with announced(lambda notice: log.info("gate.compiling", text=notice)):
        prepare()
    _warn(cell, log)
    warn_of_unknown_robots(keys.tokens or (), [robot.name for robot in cell.robots], log)
    try:
        recorder = recorder_of(cell.config, record)
        daemon = Daemon(cell, Gate, log, keys, recorder=recorder, robot_server=robot_server)
        # Objects that exist now stay until the end. Without the freeze, Python's garbage collector would
        # search all of them after many clients have disconnected, which takes as long as three ticks.
        gc.collect()
        gc.freeze()
        return asyncio.run(daemon.run(_announce))
    except OSError as error:
        where = f"{cell.config.server.host}:{cell.config.server.port}"
        text = f"cannot listen on {where}: {error.strerror or error}"
        raise ServeError(f"{text}; end the process that uses it, or give another --port") from error
    finally:
        log.close()


def _warn(cell: "Cell", log: "Log") -> None:
    """Log the warnings of ``armgate check``, and faults of the start that cause refusals."""
    from armgate.cell.cell_warnings import cell_warnings
    from armgate.daemon.lifecycle.check import REMEDY, start_faults
    from armgate.gate import start_clearances

    for text in cell_warnings(cell):
        log.warning("remark", text=text)
    faults = start_faults(cell, start_clearances(cell))
    if faults:
        more = max(0, len(faults) - _FAULTS_LOGGED)
        log.warning("start", faults=faults[:_FAULTS_LOGGED], more=more, remedy=REMEDY)


def _announce(host: str, port: int) -> None:
    if host.startswith("unix:"):
        print(f"armgate: listening on {host}", flush=True)
        return
    shown = f"[{host}]" if ":" in host else host
    print(f"armgate: listening on {shown}:{port}", flush=True)

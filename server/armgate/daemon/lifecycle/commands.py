"""``armgate serve`` and ``armgate check``."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armgate.cell.errors import install_hint

if TYPE_CHECKING:
    from ssl import SSLContext

    from armgate.cell.cell import Cell
    from armgate.cell.config import CellConfig, ServerConfig
    from armgate.daemon.auth.access import Keys
    from armgate.links.log import Log
    from armgate.protocol.messages import Role

_TOLD = 16
"""How many faults of the start are logged."""

Configs = Annotated[
    list[Path], typer.Argument(metavar="CONFIG...", help="Files; later ones overlay earlier ones.")
]


class ServeError(Exception):
    """The daemon cannot start as it was called; nothing was moved."""

    exit_code = 2


def serve(
    configs: Configs,
    host: Annotated[
        str | None, typer.Option(help="Address to listen on; beyond loopback with TLS and tokens only.")
    ] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port to listen on; 0: any.")] = None,
    lockstep: Annotated[str | None, typer.Option(metavar="NAMES", help="Run in lock-step with A,B,…")] = None,
    record: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Record everything into this folder.")
    ] = None,
    robot_server: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Socket of the robot server that holds the robots."),
    ] = None,
    require_login: Annotated[
        bool, typer.Option("--require-login", help="Refuse to start without tokens or a Unix socket.")
    ] = False,
) -> None:
    """Serve a cell to controllers and observers until SIGTERM or Ctrl-C.

    SIGHUP reads tokens and certificates again.
    """
    from armgate.cell.config import load_config

    config = _overridden(load_config(configs), host, port, lockstep)
    keys = _keys(config, require_login)
    cell = _built(config)
    raise typer.Exit(_serve(cell, keys, record, _robot_server(cell, robot_server)))


def check(configs: Configs) -> None:
    """Check a configuration: robots, joints, limits, pairs, clearance at the start."""
    from armgate.cell.config import load_config

    cell = _built(load_config(configs))
    with _cell_extra():
        from armgate.daemon.lifecycle.check import report
    raise typer.Exit(report(cell))


def _overridden(
    config: "CellConfig", host: str | None, port: int | None, lockstep: str | None
) -> "CellConfig":
    from armgate.cell.config import LockstepClockConfig

    server = {"host": config.server.host if host is None else host}
    changed: dict[str, object] = {
        "server": config.server.model_copy(update=server | ({} if port is None else {"port": port}))
    }
    if lockstep is not None:
        names = tuple(name.strip() for name in lockstep.split(","))
        grace = {"grace": config.clock.grace} if isinstance(config.clock, LockstepClockConfig) else {}
        try:
            changed["clock"] = LockstepClockConfig(kind="lockstep", participants=names, **grace)
        except ValueError as error:
            text = f"--lockstep {lockstep!r}: expected the participants' names, each once, joined by commas"
            raise ServeError(text) from error
    return config.model_copy(update=changed)


def _keys(config: "CellConfig", required: bool) -> "Keys":
    from armgate.daemon.auth.access import Keys
    from armgate.daemon.auth.address import is_loopback
    from armgate.daemon.auth.tokens import read

    server = config.server
    if not is_loopback(server.host):
        _refuse_foreign(server)
    if required and server.tokens is None and server.socket is None:
        raise ServeError(
            "--require-login: without tokens every user of this machine could command the robots; configure "
            "server.tokens or server.socket (docs/security.md)"
        )
    users, path = _local(config)
    file, tls = _token_file(config), _tls(config)
    reread = None if file is None else partial(read, file)
    return Keys(
        tls=tls,
        tokens=None if reread is None else reread(),
        reread=reread,
        users=users,
        socket=path,
        reread_tls=None if tls is None else partial(_context, config),
    )


def _local(config: "CellConfig") -> "tuple[dict[int, Role], Path | None]":
    from armgate.daemon.auth.unix_socket import uids

    local = config.server.socket
    if local is None:
        return {}, None
    return uids(local.users), config.file(("server", "socket", "path"), local.path)


def _refuse_foreign(server: "ServerConfig") -> None:
    missing = [key for key in ("tls", "tokens") if getattr(server, key) is None]
    if missing:
        raise ServeError(
            f"refusing to listen on {server.host}: without TLS and tokens anybody who reaches that address "
            f"could command the robots, or listen in; configure server.{' and server.'.join(missing)} "
            "(docs/security.md), or listen on 127.0.0.1 and reach it through a tunnel (ssh -L)"
        )


def _tls(config: "CellConfig") -> "SSLContext | None":
    return None if config.server.tls is None else _context(config)


def _context(config: "CellConfig") -> "SSLContext":
    from armgate.daemon.auth.tls import server_context

    tls = config.server.tls
    assert tls is not None
    base = ("server", "tls")
    return server_context(
        config.file((*base, "certificate"), tls.certificate),
        config.file((*base, "key"), tls.key),
        None if tls.client_ca is None else config.file((*base, "client_ca"), tls.client_ca),
    )


def _token_file(config: "CellConfig") -> Path | None:
    tokens = config.server.tokens
    return None if tokens is None else config.file(("server", "tokens"), tokens)


_CELL_EXTRA = ("pinocchio", "coal", "fcl", "mcap", "prometheus_client")


@contextmanager
def _cell_extra() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in _CELL_EXTRA:
            raise
        text = f"{error.name} is not installed; a machine with the cell needs {install_hint('cell')}"
        raise ServeError(text) from error


def _built(config: "CellConfig") -> "Cell":
    with _cell_extra():
        from armgate.cell.cell import build_cell

        return build_cell(config)


def _robot_server(cell: "Cell", given: Path | None) -> Path | None:
    """Where the robots are: in the robot server if one is named or a robot is not emulated; None: here."""
    from armgate.links.robot_server.command import robot_server_path
    from armgate.links.robot_server.make import needs_robot_server

    needed = needs_robot_server(cell)
    if not needed and given is None and cell.config.server.robot_server is None:
        return None
    if cell.config.clock.kind == "lockstep":
        raise ServeError("robots in a robot server have clocks of their own: they cannot run in lock-step")
    return given or robot_server_path(cell)


def _serve(cell: "Cell", keys: "Keys", record: Path | None, robot_server: Path | None) -> int:
    import asyncio

    from armgate.daemon.auth.reloading import warn_of_unknown_robots
    from armgate.links.log import Log

    with _cell_extra():
        from armgate.daemon.lifecycle.daemon import Daemon
        from armgate.daemon.recording.start import recorder_of
        from armgate.gate import Gate

    log = Log(sys.stderr)
    _warn(cell, log)
    warn_of_unknown_robots(keys.tokens or (), [robot.name for robot in cell.robots], log)
    try:
        recorder = recorder_of(cell.config, record)
        daemon = Daemon(cell, Gate, log, keys, recorder=recorder, robot_server=robot_server)
        # What stands now stays: looking through all of it for garbage, as Python does when many clients have
        # come and gone, takes as long as three ticks.
        gc.collect()
        gc.freeze()
        return asyncio.run(daemon.run(_announce))
    except OSError as error:
        where = f"{cell.config.server.host}:{cell.config.server.port}"
        text = (
            f"cannot listen on {where}: {error.strerror or error}; stop what uses it, or give another --port"
        )
        raise ServeError(text) from error
    finally:
        log.close()


def _warn(cell: "Cell", log: "Log") -> None:
    """Log what ``armgate check`` warns of, and why commands will be refused from the start."""
    from armgate.cell.cell_warnings import cell_warnings
    from armgate.daemon.lifecycle.check import REMEDY, start_faults
    from armgate.gate import start_clearances

    for text in cell_warnings(cell):
        log.warning("remark", text=text)
    faults = start_faults(cell, start_clearances(cell))
    if faults:
        log.warning("start", faults=faults[:_TOLD], more=max(0, len(faults) - _TOLD), remedy=REMEDY)


def _announce(host: str, port: int) -> None:
    if host.startswith("unix:"):
        print(f"armgate: listening on {host}", flush=True)
        return
    shown = f"[{host}]" if ":" in host else host
    print(f"armgate: listening on {shown}:{port}", flush=True)

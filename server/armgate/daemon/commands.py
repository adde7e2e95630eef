"""``armgate serve`` and ``armgate check``."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from armgate.cell.cell import Cell
    from armgate.cell.config import CellConfig

Configs = Annotated[
    list[Path], typer.Argument(metavar="CONFIG...", help="Files; later ones overlay earlier ones.")
]


class ServeError(Exception):
    """The daemon cannot start as it was called; nothing was moved."""

    exit_code = 2


def serve(
    configs: Configs,
    host: Annotated[str | None, typer.Option(help="Address to listen on; loopback only.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port to listen on; 0: any.")] = None,
    lockstep: Annotated[str | None, typer.Option(metavar="NAMES", help="Run in lock-step with A,B,…")] = None,
) -> None:
    """Serve a cell to controllers and observers until SIGTERM or Ctrl-C."""
    from armgate.cell.config import load_config  # noqa: PLC0415 (checked before anything heavy)

    config = _overridden(load_config(configs), host, port, lockstep)
    _refuse_foreign(config.server.host)
    raise typer.Exit(_serve(_built(config)))


def check(configs: Configs) -> None:
    """Check a configuration: robots, joints, limits, pairs, clearance at the start."""
    from armgate.cell.config import load_config  # noqa: PLC0415 (checked before anything heavy)

    cell = _built(load_config(configs))
    with _cell_extra():
        from armgate.daemon.check import report  # noqa: PLC0415
    raise typer.Exit(report(cell))


def _overridden(
    config: "CellConfig", host: str | None, port: int | None, lockstep: str | None
) -> "CellConfig":
    from armgate.cell.config import LockstepClockConfig  # noqa: PLC0415

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


def _refuse_foreign(host: str) -> None:
    from armgate.daemon.address import is_loopback  # noqa: PLC0415

    if not is_loopback(host):
        raise ServeError(
            f"refusing to listen on {host}: without TLS and tokens anybody who reaches that address could "
            "command the robots; listen on 127.0.0.1 and reach it from elsewhere through a tunnel (ssh -L)"
        )


@contextmanager
def _cell_extra() -> Iterator[None]:
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("pinocchio", "coal", "fcl"):
            raise
        text = f'{error.name} is not installed; a machine with the cell needs: pip install "armgate[cell]"'
        raise ServeError(text) from error


def _built(config: "CellConfig") -> "Cell":
    with _cell_extra():
        from armgate.cell.cell import build_cell  # noqa: PLC0415

        return build_cell(config)


def _serve(cell: "Cell") -> int:
    import asyncio  # noqa: PLC0415

    from armgate.daemon.log import Log  # noqa: PLC0415

    with _cell_extra():
        from armgate.daemon.server import Daemon  # noqa: PLC0415
        from armgate.integrity import Gate  # noqa: PLC0415

    log = Log(sys.stderr)
    try:
        return asyncio.run(Daemon(cell, Gate, log).run(_announce))
    except OSError as error:
        where = f"{cell.config.server.host}:{cell.config.server.port}"
        text = (
            f"cannot listen on {where}: {error.strerror or error}; stop what uses it, or give another --port"
        )
        raise ServeError(text) from error
    finally:
        log.close()


def _announce(host: str, port: int) -> None:
    shown = f"[{host}]" if ":" in host else host
    print(f"armgate: listening on {shown}:{port}", flush=True)  # noqa: T201

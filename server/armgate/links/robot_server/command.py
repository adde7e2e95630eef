"""``armgate robot-server``."""

import gc
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from armgate.cell.cell import Cell
    from armgate.links.systemd import Notifier


class StartError(Exception):
    """Failed start of the robot server; no robot was moved."""

    exit_code = 2


def robot_server(
    configs: Annotated[
        list[Path],
        typer.Argument(metavar="CONFIG", help="Configuration files; later ones overlay earlier ones."),
    ],
    socket: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Socket for the daemon; default: as configured."),
    ] = None,
    priority: Annotated[
        int | None,
        typer.Option(
            min=1, max=99, help="Priority as a real-time process (SCHED_RR); default: an ordinary process."
        ),
    ] = None,
) -> None:
    """Run the links of a cell's robots for its daemon until SIGTERM or Ctrl-C."""
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config

    config = load_config(configs)
    cell = build_cell(config)
    if priority is not None:
        _make_real_time(priority)
    raise typer.Exit(_serve(cell, socket or robot_server_path(cell)))


def robot_server_path(cell: "Cell") -> Path:
    """Return the socket of a cell's robot server: as configured, or in the folder of the user's sockets."""
    from armgate.links.robot_server.unix_socket import default_path

    given = cell.config.server.robot_server
    if given is None:
        return default_path(cell.name)
    return cell.config.file(("server", "robot_server"), given)


def _serve(cell: "Cell", path: Path) -> int:
    import asyncio
    from time import monotonic

    from armgate.links.log import Log
    from armgate.links.robot_server.hosted_link import host_links
    from armgate.links.robot_server.server import RobotServer
    from armgate.links.robot_server.unix_socket import listen
    from armgate.links.systemd import Notifier

    listening, lock = listen(path)
    log = Log(sys.stderr)
    with lock, listening:
        try:
            links = host_links(
                cell, monotonic, lambda robot, text: log.warning("link", robot=robot, text=text)
            )
            server = RobotServer(cell.hash, links, log)
            # Objects made so far stay: garbage collection must not search them and delay a reply.
            gc.collect()
            gc.freeze()
            return asyncio.run(server.run(listening, lambda: _announce(path, Notifier())))
        except OSError as error:
            text = f"{error.filename}: {error.strerror}" if error.filename else str(error)
            raise StartError(f"cannot open the links to the robots: {text}") from error
        finally:
            path.unlink(missing_ok=True)
            log.close()


def _make_real_time(priority: int) -> None:
    import os

    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except PermissionError as error:
        raise StartError(
            f"--priority {priority} is not allowed for this user: raise the limit `rtprio` "
            "(systemd: LimitRTPRIO), or omit the option"
        ) from error


def _announce(path: Path, manager: "Notifier") -> None:
    print(f"armgate: robot server at {path}", flush=True)
    manager.ready(f"robots at {path}")

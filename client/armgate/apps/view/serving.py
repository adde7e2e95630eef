"""Serve the page: of a daemon, with reconnection, or of a recording."""

import errno
import io
import signal
import socket
import threading
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from armgate.apps.connection import Login
from armgate.apps.errors import AppError, UsageError
from armgate.apps.view.access import Access, url_of
from armgate.apps.view.guarded_server import ServerGuard, guard_server
from armgate.apps.view.live import Live
from armgate.apps.view.message_filter import MessageFilter
from armgate.apps.view.player import Player
from armgate.apps.view.viewer import Style, Viewer
from armgate.client import ClientError, Role

AGAIN = 1.0
"""Time between two attempts to reconnect, s."""


@dataclass(frozen=True)
class Place:
    """Address of the page, and the rules of access to it."""

    host: str
    port: int
    access: Access = field(default_factory=Access)


def serve(
    address: str,
    name: str,
    role: Role,
    login: Login,
    *,
    style: Style,
    at: Place,
    open_browser: bool,
    report: Callable[[str], object],
) -> None:
    """Show a daemon's cell until SIGINT or SIGTERM.

    Raises:
        ClientError: The daemon cannot be reached at the beginning, or rejects this client.
        AppError: The page cannot be served.
    """
    with interruption() as ended:
        live: Live | None = Live(address, name, role, login)
        with page_server(at) as server:
            first = True
            while live is not None:
                with live, Viewer(server, live, style) as viewer:
                    if first:
                        _announce(server, at, viewer, open_browser, report)
                    first = False
                    viewer.run(ended)
                if not ended.is_set():
                    report(f"armgate: {live.problem}")
                live = _reconnect(address, name, role, login, ended)
                if live is not None:
                    server.scene.reset()
                    server.gui.reset()
                    report("armgate: connected again")


def play(path: Path, *, style: Style, at: Place, open_browser: bool, report: Callable[[str], object]) -> None:
    """Show a recording until SIGINT or SIGTERM.

    Raises:
        RecordingError: The recording cannot be read.
        AppError: The page cannot be served.
    """
    player = Player(path)
    with interruption() as ended, page_server(at) as server, Viewer(server, player, style) as viewer:
        _announce(server, at, viewer, open_browser, report)
        viewer.run(ended)
        if player.problem is not None:
            raise AppError(player.problem)


def _announce(
    server: Any, at: Place, viewer: Viewer, open_browser: bool, report: Callable[[str], object]
) -> None:
    port = server.get_port()
    report(f"armgate: view at {url_of(at.host, port, at.access.query())}")
    if (
        open_browser
    ):  # other users can read the arguments of a browser's process, so this address works only once
        open_page(url_of(at.host, port, at.access.query(once=True)))
    if viewer.camera_picture is not None and viewer.camera_picture.problem is not None:
        report(f"armgate: {viewer.camera_picture.problem}")


def _reconnect(address: str, name: str, role: Role, login: Login, ended: threading.Event) -> Live | None:
    while not ended.wait(AGAIN):
        try:
            return Live(address, name, role, login)
        except ClientError:
            continue
    return None


@contextmanager
def page_server(at: Place) -> Iterator[Any]:
    """Run a guarded viser server at this address.

    Raises:
        AppError: The address cannot be used.
    """
    import viser

    port = _free(at.host, at.port)
    guard = ServerGuard(at.access)
    with redirect_stdout(io.StringIO()), guard_server(guard):  # viser prints a banner
        server = viser.ViserServer(host=at.host, port=port, verbose=False)
    guard.filter = MessageFilter(server)
    try:
        yield server
    finally:
        with redirect_stdout(io.StringIO()):
            server.stop()


def _free(host: str, port: int) -> int:
    """Return the port, or a free one for 0; viser would silently replace a port in use by the next free one.

    Raises:
        AppError: The address cannot be used.
    """
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            return int(probe.getsockname()[1])
        except OSError as error:
            raise _no_port(host, port, error) from error


def _no_port(host: str, port: int, error: OSError) -> AppError:
    if error.errno == errno.EADDRINUSE:
        return AppError(f"port {port} on {host} is in use; choose another one: --port N, or 0 for any")
    return UsageError(f"the page cannot be served on {host}:{port}: {error.strerror or error}")


def open_page(url: str) -> None:
    """Open a browser if there is one."""
    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Yield an event that SIGINT or SIGTERM sets; a second signal ends the process at once."""
    ended = threading.Event()

    def take(_signum: int, _frame: object) -> None:
        if ended.is_set():
            raise KeyboardInterrupt
        ended.set()

    before = {signum: signal.signal(signum, take) for signum in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield ended
    finally:
        for signum, handler in before.items():
            signal.signal(signum, handler)

"""Robots that pages drive: acquire and release leases, and bring a robot to rest if its page was closed."""

import threading
import weakref
from collections.abc import Callable
from typing import Any

from armgate.apps.errors import AppError, text_of
from armgate.apps.lead.jog import JogProgram
from armgate.apps.lead.manual import steering_of
from armgate.apps.view.handles import Handles
from armgate.apps.view.live import Live
from armgate.apps.view.pointer_input import PointerInput
from armgate.apps.view.scene import Poses
from armgate.client import ClientError, Entry, RobotDescription, State, connect
from armgate.client.program import run_held
from armgate.client.shared_signals import SharedSignals

ENDING = 5.0
"""Longest time for a robot to come to rest when the viewer ends, s."""
HANDLES_EVERY = 2
"""Frames of the scene between two updates of the handles."""

Report = Callable[[str, str], None]


class Drive:
    """One robot that one page drives, with a connection and a thread of its own.

    So the lease ends with this process, and neither drawing nor other pages delay the robot.

    Attributes:
        robot: The robot.
        page: The page, as viser's client.
        pointer: Input of the page.
        held: True once the page holds the robot's lease.
    """

    def __init__(self, live: Live, robot: RobotDescription, page: Any, speed: float, report: Report) -> None:
        self.robot, self.page, self.pointer, self.held = robot, page, PointerInput(), False
        self._live, self._speed, self._report = live, speed, report
        self._over = threading.Event()
        threading.Thread(target=self._run, name=f"drive {robot.name}", daemon=True).start()

    @property
    def over(self) -> bool:
        """Return True if the lease was released or never acquired."""
        return self._over.is_set()

    def wait(self, timeout: float) -> None:
        """Wait until driving is over."""
        self._over.wait(timeout)

    def _run(self) -> None:
        try:
            self._report("green", self._drive())
        except (ClientError, AppError) as error:
            self._report("red", str(error))
        finally:
            self._over.set()

    def _drive(self) -> str:
        live, name = self._live, self.robot.name
        with connect(live.address, name=live.name, role=live.role, **live.login) as cell:
            steering = steering_of(cell, self.robot, self._speed)
            program = JogProgram(self.pointer, steering, self._report_gray)
            cell.subscribe(every=1, robots=[name], fields=program.fields)
            with cell.acquire(name) as arm:
                self.held = True
                return f"{name}: {text_of(run_held(arm, program, SharedSignals(cell, self._report_gray)))}"

    def _report_gray(self, text: str) -> None:
        self._report("gray", text)


class Driving:
    """Robots that the pages of one viewer drive; each robot by at most one page.

    Args:
        server: The server of viser.
        live: The connection to the daemon.
        speed: Largest share of the robots' speeds.
    """

    def __init__(self, server: Any, live: Live, speed: float) -> None:
        self._server, self._live, self._speed = server, live, speed
        self._drives: dict[str, Drive] = {}
        self._handles: dict[str, Handles] = {}
        self._frames = 0
        self._closed = False
        own = weakref.ref(self)  # viser never removes a callback

        async def gone(page: Any) -> None:
            if (driving := own()) is not None:
                driving.release(page, "the page was closed")

        server.on_client_disconnect(gone)

    def take(self, robot: RobotDescription, page: Any) -> None:
        """Acquire the robot for this page; the outcome is shown there."""
        if self._closed:
            return
        now = self._drives.get(robot.name)
        report = _reporter(self._server, page, f"Driving {robot.name}")
        if now is None or now.over:
            self._drives[robot.name] = Drive(self._live, robot, page, self._speed, report)
        elif now.page.client_id != page.client_id:
            report("red", f"{robot.name} is driven from another page of this viewer")

    def release(self, page: Any, why: str) -> None:
        """Bring the robots that this page drives to rest and release them."""
        for drive in self._drives.values():
            if drive.page.client_id == page.client_id:
                drive.pointer.end(why)

    def update(self, state: State, poses: Poses) -> None:
        """Show the handles of driven robots at their positions, and remove the others."""
        self._frames += 1
        entries = {entry.robot: entry for entry in state.entries}
        for name, drive in list(self._drives.items()):
            if drive.over:
                self._drop(name)
            elif drive.held and self._frames % HANDLES_EVERY == 0:
                self._show(drive, entries[name], poses)

    def close(self) -> None:
        """Bring all robots to rest; no robot can be acquired afterwards."""
        self._closed = True
        for drive in self._drives.values():
            drive.pointer.end("the viewer ended")
        for name, drive in list(self._drives.items()):
            drive.wait(ENDING)
            self._drop(name)

    def _show(self, drive: Drive, entry: Entry, poses: Poses) -> None:
        if entry.q is None:
            return
        robot = drive.robot
        place = poses.models[robot.name].frame(entry.q, robot.tool)
        handles = self._handles.get(robot.name)
        if handles is not None:
            handles.follow(place, entry.q)
            return
        order = 20.5 + [known.name for known in self._live.description.robots].index(robot.name)
        self._handles[robot.name] = Handles(
            drive.page, robot, drive.pointer, place=place, q=entry.q, order=order,
            release=lambda: drive.pointer.end("released"),
        )  # fmt: skip

    def _drop(self, name: str) -> None:
        del self._drives[name]
        if (handles := self._handles.pop(name, None)) is not None:
            handles.close()


def _reporter(server: Any, page: Any, title: str) -> Report:
    def report(colour: str, text: str) -> None:
        if page.client_id in server.get_clients():  # the page may be closed by now
            page.add_notification(title, text, color=colour, auto_close_seconds=8.0)

    return report

"""Who drives what from a page: takes and gives back leases, and brings robots to rest whose page is gone."""

import threading
import weakref
from collections.abc import Callable
from typing import Any

from armgate.apps.errors import AppError
from armgate.apps.interrupt import Interrupt
from armgate.apps.lead.jog import jog
from armgate.apps.lead.manual import steering_of
from armgate.apps.view.handles import Handles
from armgate.apps.view.live import Live
from armgate.apps.view.pointer_input import PointerInput
from armgate.apps.view.scene import Poses
from armgate.client import ClientError, Entry, RobotDescription, State, connect

ENDING = 5.0
"""How long a robot may take to rest when the viewer ends, s."""
HANDLES_EVERY = 2
"""Pictures of the scene between two updates of the handles."""

Tell = Callable[[str, str], None]


class Drive:
    """One robot that one page drives: a connection of its own in a thread of its own.

    So the lease ends with this process, and neither pictures nor other pages hold up the robot.

    Attributes:
        robot: What is driven.
        page: The page, as viser's client.
        grip: What the page wants.
        held: Whether the robot is this page's by now.
    """

    def __init__(self, live: Live, robot: RobotDescription, page: Any, speed: float, tell: Tell) -> None:
        self.robot, self.page, self.grip, self.held = robot, page, PointerInput(), False
        self._live, self._speed, self._tell = live, speed, tell
        self._over = threading.Event()
        threading.Thread(target=self._run, name=f"drive {robot.name}", daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether the robot was given back, or never taken."""
        return self._over.is_set()

    def wait(self, timeout: float) -> None:
        """Waits for that."""
        self._over.wait(timeout)

    def _run(self) -> None:
        try:
            self._tell("green", self._drive())
        except (ClientError, AppError) as error:
            self._tell("red", str(error))
        finally:
            self._over.set()

    def _drive(self) -> str:
        live, name = self._live, self.robot.name
        with connect(live.address, name=live.name, role=live.role, **live.login) as cell:
            steering = steering_of(cell, self.robot, self._speed)
            cell.subscribe(every=1, robots=[name], fields=["q", "setpoint"])
            with cell.acquire(name) as arm:
                self.held = True
                return f"{name}: {jog(arm, self.grip, steering, Interrupt(), self._say)}"

    def _say(self, text: str) -> None:
        self._tell("gray", text)


class Driving:
    """All that is driven from the pages of one viewer; a robot by one page at a time.

    Args:
        server: viser's.
        live: The daemon.
        speed: The largest share of the robots' speeds.
    """

    def __init__(self, server: Any, live: Live, speed: float) -> None:
        self._server, self._live, self._speed = server, live, speed
        self._drives: dict[str, Drive] = {}
        self._handles: dict[str, Handles] = {}
        self._frames = 0
        self._closed = False
        own = weakref.ref(self)  # viser keeps what it calls for ever

        async def gone(page: Any) -> None:
            if (driving := own()) is not None:
                driving.leave(page, "the page was closed")

        server.on_client_disconnect(gone)

    def take(self, robot: RobotDescription, page: Any) -> None:
        """Takes the robot for this page; what comes of it is told there."""
        if self._closed:
            return
        now = self._drives.get(robot.name)
        tell = _teller(self._server, page, f"Driving {robot.name}")
        if now is None or now.over:
            self._drives[robot.name] = Drive(self._live, robot, page, self._speed, tell)
        elif now.page.client_id != page.client_id:
            tell("red", f"{robot.name} is driven from another page of this viewer")

    def leave(self, page: Any, why: str) -> None:
        """All that this page drives comes to rest and is given back."""
        for drive in self._drives.values():
            if drive.page.client_id == page.client_id:
                drive.grip.end(why)

    def update(self, state: State, poses: Poses) -> None:
        """Shows the handles of what is driven, where the robots are, and takes away those of what is not."""
        self._frames += 1
        entries = {entry.robot: entry for entry in state.entries}
        for name, drive in list(self._drives.items()):
            if drive.over:
                self._drop(name)
            elif drive.held and self._frames % HANDLES_EVERY == 0:
                self._show(drive, entries[name], poses)

    def close(self) -> None:
        """Brings all to rest; nothing is taken any more."""
        self._closed = True
        for drive in self._drives.values():
            drive.grip.end("the viewer ended")
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
            drive.page, robot, drive.grip, place=place, q=entry.q, order=order,
            give_back=lambda: drive.grip.end("given back"),
        )  # fmt: skip

    def _drop(self, name: str) -> None:
        del self._drives[name]
        if (handles := self._handles.pop(name, None)) is not None:
            handles.close()


def _teller(server: Any, page: Any, title: str) -> Tell:
    def tell(colour: str, text: str) -> None:
        if page.client_id in server.get_clients():  # else there is nobody to tell
            page.add_notification(title, text, color=colour, auto_close_seconds=8.0)

    return tell

"""Buttons of the page: STOP for every user, reset and zoom for an operator, and one per robot to drive it."""

from collections.abc import Callable, Coroutine
from typing import Any

from armgate.apps.view.driving import Driving
from armgate.apps.view.live import Live, in_words
from armgate.client import RobotDescription

ZOOM = (0.4, 2.5)
"""Smallest and largest view distance that the slider offers, m."""

Notify = Callable[[str, str, str], None]
"""Show a notification in every browser: title, text, colour."""


class Buttons:
    """Controls that send a request to the daemon and report its outcome on the page.

    Args:
        gui: The GUI of viser's server.
        live: The daemon's connection.
        notify: Shows a notification in every browser.
    """

    def __init__(self, gui: Any, live: Live, notify: Notify) -> None:
        self._gui, self._live, self._notify = gui, live, notify
        self._requested: set[tuple[int, str]] = set()
        self._running: set[tuple[int, str]] = set()
        stop = gui.add_button("STOP", color="red", icon="hand-stop", order=1, hint="Stop every robot")
        self._on(stop.on_click, "STOP", lambda: live.stop("STOP was pressed on the page"))
        if live.operator:
            self._add_operator_controls()

    def _add_operator_controls(self) -> None:
        reset = self._gui.add_button("Reset", order=2, hint="Reset every stop in force")
        self._on(reset.on_click, "Reset", self._live.reset)
        zoom = self._gui.add_slider("Zoom [m]", *ZOOM, 0.05, 1.0, order=3, hint="Wanted view distance")
        self._on(zoom.on_update, "Zoom", lambda: _zoom(self._live, float(zoom.value)), quiet=True)

    def add_driving(self, driving: Driving) -> None:
        """Add a button per robot that acquires the robot for the page on which it is pressed."""
        for i, robot in enumerate(self._live.description.robots):
            hint = "Acquire the lease and move the robot by hand, from this page"
            button = self._gui.add_button(f"Drive {robot.name}", icon="hand-move", order=20.4 + i, hint=hint)
            button.on_click(_taking(driving, robot))

    def _on(
        self,
        register: Callable[[Any], object],
        title: str,
        act: Callable[[], Coroutine[Any, Any, str]],
        *,
        quiet: bool = False,
    ) -> None:
        """Start ``act`` when a control is used.

        One call of ``act`` runs at a time per page and control; if the control is used meanwhile, ``act``
        runs again. It is a coroutine, not a thread of viser's pool, so a page cannot block others by flooding
        a control.
        """

        async def used(event: Any) -> None:
            if event.client is None:
                return  # the value was set by this process
            key = (event.client_id, title)
            self._requested.add(key)
            if key in self._running:
                return
            self._running.add(key)
            try:
                while key in self._requested:
                    self._requested.discard(key)
                    self._report(title, *await in_words(act()), quiet=quiet)
            finally:
                self._running.discard(key)

        register(used)

    def _report(self, title: str, done: bool, text: str, *, quiet: bool) -> None:
        if not (done and quiet):
            self._notify(title, text, "green" if done else "red")


def _taking(driving: Driving, robot: RobotDescription) -> Callable[[Any], Any]:
    async def pressed(event: Any) -> None:
        driving.take(robot, event.client)

    return pressed


async def _zoom(live: Live, distance: float) -> str:
    await live.signal("operator.distance", distance)
    return f"wanted view distance {distance:.2f} m"

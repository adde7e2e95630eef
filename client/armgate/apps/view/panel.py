"""The panel: the robots' states in words and bars, and what anybody, or an operator, can do."""

from collections.abc import Callable, Coroutine
from typing import Any

from armgate.apps.view import looks
from armgate.apps.view.driving import Driving
from armgate.apps.view.live import Live, in_words
from armgate.apps.view.overlays import Overlays
from armgate.apps.view.source import Source
from armgate.apps.view.texts import banner, note, robot_html
from armgate.client import Description, RobotDescription, State

ZOOM = (0.4, 2.5)
"""Wanted view distances that can be chosen, m."""
QUIET: looks.RGB = (70, 84, 104)


class Panel:
    """What stands beside the picture.

    Args:
        gui: The page's.
        description: The cell.
        notify: Tells every browser: title, text, colour.
    """

    def __init__(self, gui: Any, description: Description, notify: Callable[[str, str, str], None]) -> None:
        self._gui, self._description, self._notify = gui, description, notify
        self._told: dict[int, str] = {}
        self._wanted: set[tuple[int, str]] = set()
        self._busy: set[tuple[int, str]] = set()
        self._banner = gui.add_html("", order=0)
        self._robots = {
            robot.name: gui.add_html("", order=20 + i) for i, robot in enumerate(description.robots)
        }

    def add_controls(self, live: Live) -> None:
        """STOP for everybody; reset and zoom for an operator."""
        stop = self._gui.add_button("STOP", color="red", icon="hand-stop", order=1, hint="Stop every robot")
        self._on(stop.on_click, "STOP", lambda: live.stop("STOP was pressed on the page"))
        if not live.operator:
            return
        reset = self._gui.add_button("Reset", order=2, hint="Lift the stops in force")
        self._on(reset.on_click, "Reset", live.reset)
        zoom = self._gui.add_slider("Zoom [m]", *ZOOM, 0.05, 1.0, order=3, hint="Wanted view distance")
        self._on(zoom.on_update, "Zoom", lambda: _zoom(live, float(zoom.value)), quiet=True)

    def add_driving(self, driving: Driving) -> None:
        """A button for each robot that takes it for the page on which it is pressed."""
        for i, robot in enumerate(self._description.robots):
            hint = "Take the lease and move it by hand, from this page"
            button = self._gui.add_button(f"Drive {robot.name}", icon="hand-move", order=20.4 + i, hint=hint)
            button.on_click(_taking(driving, robot))

    def add_overlays(self, overlays: Overlays) -> None:
        """A box to tick for each overlay."""
        with self._gui.add_folder("Overlays", order=40, expand_by_default=False):
            for name in overlays.shown:
                box = self._gui.add_checkbox(name.capitalize(), overlays.shown[name])
                box.on_update(_showing(overlays, name))

    def update(self, state: State, source: Source) -> None:
        """Shows a state of a source."""
        self._say(self._banner, self._headline(state, source))
        entries = {entry.robot: entry for entry in state.entries}
        for robot in self._description.robots:
            self._say(self._robots[robot.name], robot_html(robot, entries[robot.name]))

    def fail(self, problem: str) -> None:
        """Says why nothing comes any more."""
        self._say(self._banner, banner(problem, looks.STATES["stop"]))

    def _headline(self, state: State, source: Source) -> str:
        if source.problem is not None:
            return banner(source.problem, looks.STATES["stop"])
        stops = sorted({stop for entry in state.entries for stop in entry.stops or ()})
        if stops:
            told = f"stop {', '.join(map(str, stops))} in force: an operator resets it"
            return banner(f"{source.told(state)}: {told}", looks.STATES["stop"])
        return banner(source.told(state), QUIET) + note(state.warnings)

    def _say(self, handle: Any, html: str) -> None:
        if self._told.get(id(handle)) != html:
            self._told[id(handle)] = html
            handle.content = html

    def _on(
        self,
        register: Callable[[Any], object],
        title: str,
        act: Callable[[], Coroutine[Any, Any, str]],
        *,
        quiet: bool = False,
    ) -> None:
        """Have a control start an act: one at a time for each page, and once more if it was wanted meanwhile.

        A coroutine, not a thread of viser's pool: a page that floods one control cannot occupy the others.
        """

        async def used(event: Any) -> None:
            if event.client is None:
                return  # set by this process
            key = (event.client_id, title)
            self._wanted.add(key)
            if key in self._busy:
                return
            self._busy.add(key)
            try:
                while key in self._wanted:
                    self._wanted.discard(key)
                    self._report(title, *await in_words(act()), quiet=quiet)
            finally:
                self._busy.discard(key)

        register(used)

    def _report(self, title: str, done: bool, text: str, *, quiet: bool) -> None:
        if not (done and quiet):
            self._notify(title, text, "green" if done else "red")


def _taking(driving: Driving, robot: RobotDescription) -> Callable[[Any], Any]:
    async def pressed(event: Any) -> None:
        driving.take(robot, event.client)

    return pressed


def _showing(overlays: Overlays, name: str) -> Callable[[Any], Any]:
    async def ticked(event: Any) -> None:
        overlays.shown[name] = bool(event.target.value)

    return ticked


async def _zoom(live: Live, distance: float) -> str:
    await live.signal("operator.distance", distance)
    return f"wanted view distance {distance:.2f} m"

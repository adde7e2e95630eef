"""Panel beside the scene: banner with the cell's state, a block per robot, check boxes of the overlays."""

from collections.abc import Callable
from typing import Any

from armgate.apps.view import colours
from armgate.apps.view.overlays import Overlays
from armgate.apps.view.panel_html import banner, note, robot_html
from armgate.apps.view.source import Source
from armgate.client import Description, State

NEUTRAL: colours.RGB = (70, 84, 104)


class StatePanel:
    """State of the cell and its robots as HTML; only changes are sent to the page.

    Args:
        gui: The GUI of viser's server.
        description: The cell.
    """

    def __init__(self, gui: Any, description: Description) -> None:
        self._gui, self._description = gui, description
        self._shown: dict[int, str] = {}
        self._banner = gui.add_html("", order=0)
        self._robots = {
            robot.name: gui.add_html("", order=20 + i) for i, robot in enumerate(description.robots)
        }

    def add_overlays(self, overlays: Overlays) -> None:
        """Add a check box per overlay."""
        with self._gui.add_folder("Overlays", order=40, expand_by_default=False):
            for name in overlays.shown:
                box = self._gui.add_checkbox(name.capitalize(), overlays.shown[name])
                box.on_update(_showing(overlays, name))

    def update(self, state: State, source: Source) -> None:
        """Show a state of a source."""
        self._show(self._banner, self._headline(state, source))
        entries = {entry.robot: entry for entry in state.entries}
        for robot in self._description.robots:
            self._show(self._robots[robot.name], robot_html(robot, entries[robot.name]))

    def fail(self, problem: str) -> None:
        """Show why no more states arrive."""
        self._show(self._banner, banner(problem, colours.STATES["stop"]))

    def _headline(self, state: State, source: Source) -> str:
        if source.problem is not None:
            return banner(source.problem, colours.STATES["stop"])
        stops = sorted({stop for entry in state.entries for stop in entry.stops or ()})
        if stops:
            active = f"stop {', '.join(map(str, stops))} in force; an operator can reset it"
            return banner(f"{source.describe(state)}: {active}", colours.STATES["stop"])
        return banner(source.describe(state), NEUTRAL) + note(state.warnings)

    def _show(self, handle: Any, html: str) -> None:
        if self._shown.get(id(handle)) != html:
            self._shown[id(handle)] = html
            handle.content = html


def _showing(overlays: Overlays, name: str) -> Callable[[Any], Any]:
    async def ticked(event: Any) -> None:
        overlays.shown[name] = bool(event.target.value)

    return ticked

"""Handles of a robot that a page drives: a gizmo at the tool, and a slider for each joint."""

import math
from collections.abc import Callable
from html import escape
from typing import Any

from armgate.apps.lead.motions import ToolTarget
from armgate.apps.view.pointer_input import PointerInput
from armgate.apps.view.pointer_script import add_pointer_buttons
from armgate.apps.view.scene_nodes import moved, wxyz
from armgate.cell.placement import Placement
from armgate.client import Joint, RobotDescription

SIZE = 0.45
"""Size of the gizmo, m."""
_LABEL = 8
"""Longest label beside a slider, characters."""

HINT = "Hold a slider, or an arrow or arc at the tool. The robot comes to rest when you release it."


class Handles:
    """Handles of one robot on one page; other pages do not show them.

    Args:
        page: The page, as viser's client object.
        robot: The robot.
        pointer: Input that receives the handles' motions.
        place: Pose of the tool.
        q: Joint positions (n,), rad or m.
        release: Called when the user releases the robot.
        order: Position in the panel.
    """

    def __init__(
        self,
        page: Any,
        robot: RobotDescription,
        pointer: PointerInput,
        *,
        place: Placement,
        q: Any,
        release: Callable[[], None],
        order: float,
    ) -> None:
        self._input, self._robot = pointer, robot
        with page.atomic():
            self._folder = page.gui.add_folder(f"Driving {robot.name}", order=order)
            with self._folder:
                page.gui.add_html(f'<div style="margin:0 10px 6px;font-size:12px;color:#68707a">{HINT}</div>')
                self._sliders = [
                    self._slider(page.gui, number, joint, q[number])
                    for number, joint in enumerate(robot.joints)
                ]
                button = page.gui.add_button(f"Release {robot.name}", color="gray")
                add_pointer_buttons(page.gui, pointer.hold, pointer.release)
            self._gizmo = page.scene.add_transform_controls(
                f"/drive/{robot.name}", SIZE, line_width=4.0, depth_test=False, disable_sliders=True,
                position=place.t, wxyz=wxyz(place),
            )  # fmt: skip

        # Coroutines: plain functions would run in threads that may overtake each other.
        async def release_pressed(_event: Any) -> None:
            release()

        async def gizmo_moved(event: Any) -> None:
            if event.phase == "end":
                pointer.release()
            else:
                pointer.move_to(ToolTarget(self._pulled()))

        button.on_click(release_pressed)
        self._gizmo.on_update(gizmo_moved)

    def follow(self, place: Placement, q: Any) -> None:
        """Show the robot's position; a handle that is held shows its target instead."""
        if self._input.moving:
            return
        if moved(self._pulled(), place):
            self._gizmo.position, self._gizmo.wxyz = place.t, wxyz(place)
        for slider, joint, value in zip(self._sliders, self._robot.joints, q, strict=True):
            slider.value = _on_slider(joint, value)

    def close(self) -> None:
        """Remove the handles."""
        self._folder.remove()
        self._gizmo.remove()

    def _slider(self, gui: Any, number: int, joint: Joint, value: float) -> Any:
        low, high = (_shown(joint, limit) for limit in (joint.lower, joint.upper))
        unit = f"[{'°' if joint.unit == 'rad' else 'm'}]"
        name = f"{joint.name} {unit}"
        if len(name) > _LABEL:  # it does not fit beside the slider
            gui.add_html(f'<div style="margin:4px 10px 0;font-size:12px">{escape(joint.name)}</div>')
            name = unit
        slider = gui.add_slider(name, low, high, _step(joint), _on_slider(joint, value))

        async def moved_by_hand(event: Any) -> None:
            if event.client is not None:  # otherwise this process set it
                self._input.move_joint(number, _from_slider(joint, slider.value))

        slider.on_update(moved_by_hand)
        return slider

    def _pulled(self) -> Placement:
        w, x, y, z = self._gizmo.wxyz
        return Placement.from_quaternion(self._gizmo.position.tolist(), (x, y, z, w))


def _shown(joint: Joint, value: float) -> float:
    return math.degrees(value) if joint.unit == "rad" else float(value)


def _from_slider(joint: Joint, value: float) -> float:
    return math.radians(value) if joint.unit == "rad" else float(value)


def _step(joint: Joint) -> float:
    return 0.1 if joint.unit == "rad" else 0.001


def _on_slider(joint: Joint, value: float) -> float:
    """Return a position as the slider shows it: within its ends, and rounded to reduce traffic."""
    low, high = (_shown(joint, limit) for limit in (joint.lower, joint.upper))
    return min(max(round(_shown(joint, value), 1 if joint.unit == "rad" else 3), low), high)

"""What a page gets for a robot that it drives: a gizmo at the tool, and a slider for each joint."""

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
"""Of the gizmo, m."""
_LABEL = 8
"""Longest label beside a slider, in characters."""

HINT = "Hold a slider, or the arrows and arcs at the tool. Let go, and the robot comes to rest."


class Handles:
    """The handles of one robot on one page; others do not see them.

    Args:
        page: The page, as viser's client.
        robot: What is driven.
        grip: What is told of the handles.
        place: Of the tool.
        q: Of the joints (n,), rad or m.
        give_back: Called when the robot is given back.
        order: Where in the panel.
    """

    def __init__(
        self,
        page: Any,
        robot: RobotDescription,
        grip: PointerInput,
        *,
        place: Placement,
        q: Any,
        give_back: Callable[[], None],
        order: float,
    ) -> None:
        self._grip, self._robot = grip, robot
        with page.atomic():
            self._folder = page.gui.add_folder(f"Driving {robot.name}", order=order)
            with self._folder:
                page.gui.add_html(f'<div style="margin:0 10px 6px;font-size:12px;color:#68707a">{HINT}</div>')
                self._sliders = [
                    self._slider(page.gui, number, joint, q[number])
                    for number, joint in enumerate(robot.joints)
                ]
                back = page.gui.add_button(f"Give {robot.name} back", color="gray")
                add_pointer_buttons(page.gui, grip.beat, grip.release)
            self._gizmo = page.scene.add_transform_controls(
                f"/drive/{robot.name}", SIZE, line_width=4.0, depth_test=False, disable_sliders=True,
                position=place.t, wxyz=wxyz(place),
            )  # fmt: skip

        # Coroutines: plain functions would run in threads that may overtake each other.
        async def back_pressed(_event: Any) -> None:
            give_back()

        async def gizmo_moved(event: Any) -> None:
            if event.phase == "end":
                grip.release()
            else:
                grip.pull(ToolTarget(self._pulled()))

        back.on_click(back_pressed)
        self._gizmo.on_update(gizmo_moved)

    def follow(self, place: Placement, q: Any) -> None:
        """Shows where the robot is; a handle that is held shows what is wanted instead."""
        if self._grip.pulling:
            return
        if moved(self._pulled(), place):
            self._gizmo.position, self._gizmo.wxyz = place.t, wxyz(place)
        for slider, joint, value in zip(self._sliders, self._robot.joints, q, strict=True):
            slider.value = _on_slider(joint, value)

    def close(self) -> None:
        """Takes them away."""
        self._folder.remove()
        self._gizmo.remove()

    def _slider(self, gui: Any, number: int, joint: Joint, value: float) -> Any:
        low, high = (_shown(joint, limit) for limit in (joint.lower, joint.upper))
        unit = f"[{'°' if joint.unit == 'rad' else 'm'}]"
        name = f"{joint.name} {unit}"
        if len(name) > _LABEL:  # beside the slider there is no room for it
            gui.add_html(f'<div style="margin:4px 10px 0;font-size:12px">{escape(joint.name)}</div>')
            name = unit
        slider = gui.add_slider(name, low, high, _step(joint), _on_slider(joint, value))

        async def moved_by_hand(event: Any) -> None:
            if event.client is not None:  # else it was set here
                self._grip.pull_joint(number, _meant(joint, slider.value))

        slider.on_update(moved_by_hand)
        return slider

    def _pulled(self) -> Placement:
        w, x, y, z = self._gizmo.wxyz
        return Placement.from_quaternion(self._gizmo.position.tolist(), (x, y, z, w))


def _shown(joint: Joint, value: float) -> float:
    return math.degrees(value) if joint.unit == "rad" else float(value)


def _meant(joint: Joint, value: float) -> float:
    return math.radians(value) if joint.unit == "rad" else float(value)


def _step(joint: Joint) -> float:
    return 0.1 if joint.unit == "rad" else 0.001


def _on_slider(joint: Joint, value: float) -> float:
    """A position as the slider can show it: within its ends, and rounded, so that little is sent."""
    low, high = (_shown(joint, limit) for limit in (joint.lower, joint.upper))
    return min(max(round(_shown(joint, value), 1 if joint.unit == "rad" else 3), low), high)

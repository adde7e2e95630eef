"""Handles of a robot on a page: labels of its sliders."""

import asyncio
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from armgate.apps.view.handles import Handles
from armgate.cell.placement import Placement


@pytest.mark.parametrize(
    ("joint", "unit", "label", "above"),
    [
        ("A1", "rad", "A1 [°]", None),
        ("E1", "m", "E1 [m]", None),
        ("wrist_1_joint", "rad", "[°]", "wrist_1_joint"),
        ("left_finger_slide", "m", "[m]", "left_finger_slide"),
    ],
)
def test_a_long_joint_name_is_shown_above_its_slider(monkeypatch, joint, unit, label, above):
    monkeypatch.setattr("armgate.apps.view.handles.add_pointer_buttons", MagicMock())
    page = MagicMock()
    robot = SimpleNamespace(name="R", joints=[SimpleNamespace(name=joint, unit=unit, lower=-1.0, upper=1.0)])
    asyncio.run(_made(page, robot))
    assert page.gui.add_slider.call_args.args[0] == label
    shown = [call.args[0] for call in page.gui.add_html.call_args_list[1:]]
    assert [f">{above}<" in text for text in shown] == ([] if above is None else [True])


async def _made(page, robot):
    Handles(page, robot, MagicMock(), place=Placement.identity(), q=[0.0], release=MagicMock(), order=1.0)

"""Pursuit: the position of the target body, and the motion towards it."""

import numpy as np
import pytest

from armgate.apps.default_files import default_file
from armgate.apps.errors import UsageError
from armgate.apps.lead.motions import RobotState
from armgate.apps.lead.pursuit import Pursuit, TargetBody
from armgate.apps.lead.shaping import Bounds
from armgate.apps.lead.steering import Steering
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from armgate.control.redundancy.tasks import ROWS, FrameTask

T = 0.012


@pytest.fixture(scope="module")
def cell() -> Cell:
    return build_cell(load_config([default_file("demo.yaml")]))


def test_the_tool_reaches_the_body_at_its_speed_and_keeps_its_orientation(cell: Cell) -> None:
    fr, gr = cell.robot("FR"), cell.robot("GR")
    bounds = Bounds(gr.velocity, gr.acceleration, gr.deceleration, T)
    task = FrameTask(gr.model, gr.tool, ROWS)
    steering = Steering(bounds, gr.lower, gr.upper, 1.0, task, tool_speed=0.5)
    target = TargetBody.of("FR", "link_3", fr.model)
    pursuit = Pursuit(target, gr.model, gr.tool)
    setpoint, last, q = np.array(gr.start), np.zeros(9), np.array(fr.start)
    posture, speeds = gr.model.frame(setpoint, gr.tool).R, []
    for k in range(500):
        q[0] = 0.3 * np.sin(0.5 * k * T)  # the body moves away
        request = pursuit.request(RobotState(k * T, setpoint, setpoint, {"FR": q}))
        assert request.motion is not None
        last = steering.step(request.motion, setpoint, last)
        before = gr.model.frame(setpoint, gr.tool).t
        setpoint = setpoint + last
        speeds.append(np.linalg.norm(gr.model.frame(setpoint, gr.tool).t - before) / T)
    at = gr.model.frame(setpoint, gr.tool)
    assert np.linalg.norm(at.t - target.place(q)) < 0.06
    assert 0.45 < max(speeds) < 0.55
    np.testing.assert_allclose(at.R, posture, atol=0.02)


def test_a_pursuit_rests_while_the_target_is_unknown(cell: Cell) -> None:
    gr = cell.robot("GR")
    pursuit = Pursuit(TargetBody.of("FR", "shoulder", cell.robot("FR").model), gr.model, gr.tool)
    request = pursuit.request(RobotState(0.0, gr.start, gr.start))
    assert (request.motion, request.ended) == (None, "")


def test_an_unknown_body_to_pursue_is_named(cell: Cell) -> None:
    with pytest.raises(UsageError, match="no moving body 'nose'; it has link_1, shoulder, link_2"):
        TargetBody.of("FR", "nose", cell.robot("FR").model)
    with pytest.raises(UsageError, match="no moving body 'base_link'"):
        TargetBody.of("FR", "base_link", cell.robot("FR").model)

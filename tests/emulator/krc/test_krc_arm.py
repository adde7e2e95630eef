"""Tests of the robot of a virtual KRC: built-in, from a URDF, and from a cell."""

from pathlib import Path

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.urdf import read_urdf
from armgate.emulator.krc import KrcError, kr16
from armgate.emulator.krc.robot.arm import arm_of_cell, arm_of_urdf

CONFIGS = Path(__file__).parents[3] / "configs"
KR16 = read_urdf((CONFIGS / "robots" / "kr16.urdf").read_text())


@pytest.mark.parametrize(
    ("angles", "place"),
    [
        ((0, 0, 0, 0, 0, 0), (1768, 0, 640)),
        ((0, -90, 90, 0, 0, 0), (1088, 0, 1320)),
        ((0, -90, 90, 0, 90, 0), (930, 0, 1162)),
        ((90, -90, 90, 0, 90, 0), (0, -930, 1162)),
        ((30, -60, 75, 40, 50, -100), (1097.511, -723.484, 940.836)),
    ],
)
@pytest.mark.parametrize("arm", [kr16(), arm_of_urdf(KR16, "tool0")], ids=["built-in", "urdf"])
def test_the_flange_position_agrees_with_published_positions(arm, angles, place):
    assert arm.chain.pose(angles)[:3] == pytest.approx(place, abs=1e-3)


def test_the_flange_orientation_follows_kukas_convention():
    """With all axes at zero, the flange's z points along the arm; +A1 turns clockwise, seen from above."""
    assert kr16().chain.pose((0,) * 6)[3:] == pytest.approx((0, 90, 0), abs=1e-9)
    A, B, C = kr16().chain.pose((-30, 0, 0, 0, -90, 0))[3:]
    assert pytest.approx((30, 0, 0), abs=1e-9) == (A, B, C)


def test_the_built_in_robot_equals_the_urdf():
    built, read = kr16(), arm_of_urdf(KR16, "tool0")
    assert built.names == read.names
    for one, other in zip(built.axes, read.axes, strict=True):
        for name in ("lower", "upper", "speed", "acceleration"):
            assert getattr(one, name) == pytest.approx(getattr(other, name))


def test_a_cells_robot_on_a_gantry_has_external_axes_in_mm():
    robot = build_cell(load_config([CONFIGS / "demo.yaml"])).robot("GR")
    arm = arm_of_cell(robot, read_urdf(robot.urdf))
    assert arm.names == ("A1", "A2", "A3", "A4", "A5", "A6", "E1", "E2", "E3")
    assert arm.start == pytest.approx((0, -90, 90, 0, -90, 0, 2930, 0, 2480))
    e1 = arm.axes[6]
    assert (e1.unit, e1.lower, e1.upper, e1.speed) == ("mm", 1000.0, 3500.0, 1000.0)
    assert e1.acceleration == pytest.approx(4000.0)
    assert arm.axes[0].acceleration == pytest.approx(624.0)
    # RIst is in ROBROOT: the carriage does not move it.
    assert arm.chain.pose((0, 0, 0, 0, 0, 0))[:3] == pytest.approx((1768, 0, 640))


def test_a_start_with_another_number_of_values_is_refused():
    assert kr16().starting([1, 2, 3, 4, 5, 6]).start == (1, 2, 3, 4, 5, 6)
    for start in ([0] * 5, [float("nan")] * 6):
        with pytest.raises(KrcError, match="expected 6 finite ones: A1"):
            kr16().starting(start)


def test_robots_with_joints_unlike_a_kuka_are_refused():
    with pytest.raises(KrcError, match="there is no link 'tool9'"):
        arm_of_urdf(KR16, "tool9")
    with pytest.raises(KrcError, match="are not those of a KUKA robot"):
        arm_of_urdf(KR16, "base_link")

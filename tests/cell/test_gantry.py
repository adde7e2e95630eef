import xml.etree.ElementTree as ET

import numpy as np
import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError, ModelError
from armgate.cell.urdf import read_urdf
from armgate.cell.urdf.gantry import add_gantry


def test_the_arm_keeps_its_names(demo, configs):
    arm = read_urdf((configs / "robots/kr16.urdf").read_text())
    composed = read_urdf(demo.robot("GR").urdf)
    assert composed.root == "gantry"
    assert set(arm.links) < set(composed.links)
    assert {joint.name for joint in arm.joints} < {joint.name for joint in composed.joints}
    names = [joint.name for joint in demo.robot("GR").model.joints]
    assert names == ["X", "Y", "Z", "A1", "A2", "A3", "A4", "A5", "A6"]


def test_joints_are_world_coordinates_of_the_carriage(demo):
    robot = demo.robot("GR")
    for carriage in ([2.93, 0.0, 2.48], [1.0, -1.5, 1.9], [3.5, 1.5, 3.2]):
        q = np.array([*carriage, *robot.start[3:]])
        assert np.allclose(robot.model.frame(q, "gantry_z").t, carriage)
        assert np.allclose(robot.model.frame(q, "base_link").t, carriage)


def test_travel_and_speed_become_limits(demo):
    robot = demo.robot("GR")
    assert robot.lower[:3].tolist() == [1.0, -1.5, 1.9]
    assert robot.upper[:3].tolist() == [3.5, 1.5, 3.2]
    assert robot.velocity[:3].tolist() == [1.0] * 3
    assert robot.acceleration[:3].tolist() == [4.0] * 3


def test_the_demo_tool_hangs_down_towards_the_floor_robot(demo):
    robot = demo.robot("GR")
    tool = robot.model.frame(robot.start, "tool0")
    assert np.allclose(tool.t, [2.0, 0.0, 1.002], atol=1e-9)
    assert np.allclose(tool.R[:, 2], [0, 0, -1], atol=1e-9)
    assert np.allclose(robot.model.frame(robot.start, "base_link").R[:, 2], [0, 0, -1], atol=1e-9)


def test_every_axis_moves_its_bodies(demo):
    bodies = {body.name: body.joint for body in demo.robot("GR").model.bodies}
    assert bodies["gantry_rail_left"] == bodies["gantry_post_right_back"] == -1
    assert [bodies[name] for name in ("gantry_bridge", "gantry_trolley", "gantry_column")] == [0, 1, 2]
    assert bodies["base_link"] == 2


def test_the_column_reaches_the_trolley_from_the_lowest_carriage(demo):
    model = demo.robot("GR").model
    index = [body.name for body in model.bodies].index("gantry_column")
    q = demo.robot("GR").start.copy()
    q[2] = 1.9
    _, t = model.body_placements(q)
    column = model.bodies[index].shape
    assert t[index][2] - column.z / 2 == pytest.approx(1.9)
    assert t[index][2] + column.z / 2 >= 3.8


def test_a_gantry_can_have_its_own_acceleration(configs, tmp_path):
    overlay = tmp_path / "o.yaml"
    overlay.write_text(
        "robots: {GR: {gantry: {acceleration: 2 m/s2}, joints: {Y: {deceleration: 3 m/s2}}}}\n"
    )
    robot = build_cell(load_config([configs / "demo.yaml", overlay])).robot("GR")
    assert robot.acceleration[:3].tolist() == [2.0, 2.0, 2.0]
    assert robot.deceleration[:3].tolist() == [2.0, 3.0, 2.0]
    assert robot.acceleration[3] == pytest.approx(robot.velocity[3] / 0.25)


def test_an_arm_with_names_of_the_gantry_is_refused(demo):
    gantry = demo.config.robots["GR"].gantry
    text = demo.robot("FR").urdf.replace('"A1"', '"X"')
    with pytest.raises(ModelError, match="the arm uses the gantry's names X; expected others"):
        add_gantry(ET.fromstring(text), gantry)


def test_an_arm_with_a_name_of_the_gantry_is_an_error_of_the_key_gantry(configs, tmp_path):
    arm = tmp_path / "arm.urdf"
    arm.write_text((configs / "robots/kr16.urdf").read_text().replace('name="A1"', 'name="Y"'))
    overlay = tmp_path / "o.yaml"
    overlay.write_text("robots:\n  GR:\n    urdf: arm.urdf\n")
    with pytest.raises(
        ConfigError, match=r"demo\.yaml:\d+: robots\.GR\.gantry: the arm uses the gantry's names Y"
    ):
        build_cell(load_config([configs / "demo.yaml", overlay]))

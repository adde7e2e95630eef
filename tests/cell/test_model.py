import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.cell.errors import ModelError
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement
from armgate.cell.urdf import read_urdf

TREE = """<robot name="tree">
<link name="root"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<link name="plate"/>
<link name="slide"><collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link>
<link name="left"><collision><origin xyz="0.3 0 0"/>
  <geometry><capsule radius="0.05" length="0.4"/></geometry></collision></link>
<link name="right"><collision><origin xyz="0 0.2 0.1" rpy="1 0 0"/>
  <geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
<link name="tip"/>
<joint name="glue" type="fixed"><parent link="root"/><child link="plate"/>
  <origin xyz="0 0 0.2" rpy="0 0 1"/></joint>
<joint name="L" type="revolute"><parent link="plate"/><child link="left"/>
  <origin xyz="0.1 0 0" rpy="0.3 0 0"/><axis xyz="1 1 0"/><limit lower="-2" upper="2" velocity="1"/></joint>
<joint name="S" type="prismatic"><parent link="left"/><child link="slide"/>
  <origin xyz="0.6 0 0" rpy="0 0.4 0"/><axis xyz="0 0 2"/>
  <limit lower="-0.5" upper="0.7" velocity="1"/></joint>
<joint name="T" type="revolute"><parent link="slide"/><child link="right"/>
  <origin xyz="0 0.1 0"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="1"/></joint>
<joint name="end" type="fixed"><parent link="right"/><child link="tip"/>
  <origin xyz="0 0 0.5" rpy="0 1 0"/></joint>
</robot>"""
BASE = Placement.from_rpy((0.5, -1.0, 2.0), (0.1, 0.7, -2.0))


@pytest.fixture(scope="module")
def tree():
    return RobotModel.from_urdf(TREE, BASE)


@pytest.fixture(scope="module")
def models(tree, demo, planar):
    return [tree, *(robot.model for robot in (*demo.robots, *planar.robots))]


def sample(model, rng):
    return rng.uniform(model.lower, model.upper)


def frame_in_tree(model, text, q, link):
    """Return a link's frame by walking the tree of the URDF, independently of pinocchio."""
    urdf = read_urdf(text)
    values = dict(zip((joint.name for joint in model.joints), q, strict=True))
    placement = Placement.identity()
    while link != urdf.root:
        (joint,) = (joint for joint in urdf.joints if joint.child == link)
        placement = joint.origin @ moved(joint, values.get(joint.name, 0.0)) @ placement
        link = joint.parent
    return model.base @ placement


def moved(joint, value):
    axis = np.array(joint.axis)
    if joint.kind == "revolute":
        return Placement.from_quaternion((0, 0, 0), (*(np.sin(value / 2) * axis), np.cos(value / 2)))
    return Placement(np.eye(3), value * axis)


# --- KR 16: forward kinematics, tool0 in the base, against published figures -------------------------


@pytest.mark.parametrize(
    ("degrees", "xyz", "tolerance"),
    [
        ((0, 0, 0, 0, 0, 0), (1768, 0, 640), 0.5),
        ((0, -90, 90, 0, 0, 0), (1088, 0, 1320), 0.5),
        ((0, -90, 90, 0, 90, 0), (930, 0, 1162), 0.5),
        ((90, -90, 90, 0, 90, 0), (0, -930, 1162), 0.5),
        ((30, -60, 75, 40, 50, -100), (1097.511, -723.484, 940.836), 1e-3),
    ],
)
def test_kr16_reaches_the_published_points(demo, degrees, xyz, tolerance):
    tool = demo.robot("FR").model.frame(np.radians(degrees), "tool0")
    assert np.abs(1000 * tool.t - xyz).max() < tolerance


def test_kr16_flange_points_down_with_the_wrist_bent(demo):
    tool = demo.robot("FR").model.frame(np.radians([0, -90, 90, 0, 90, 0]), "tool0")
    assert np.allclose(tool.R[:, 2], [0, 0, -1], atol=1e-12)


def test_kr16_limits_and_speeds(demo):
    model = demo.robot("FR").model
    assert np.degrees(model.lower) == pytest.approx([-185, -155, -130, -350, -130, -350])
    assert np.degrees(model.upper) == pytest.approx([185, 35, 154, 350, 130, 350])
    assert np.degrees(model.velocity) == pytest.approx([156, 156, 156, 330, 330, 615])
    assert [joint.name for joint in model.joints] == ["A1", "A2", "A3", "A4", "A5", "A6"]


def test_kr16_wrist_centre_reaches_1611_mm(demo):
    model = demo.robot("FR").model
    stretch = np.arctan2(0.035, 0.67)
    wrist = model.frame([0, 0, -stretch, 0, 0, 0], "link_4").t
    assert np.hypot(wrist[0], wrist[2] - 0.675) == pytest.approx(1.6109, abs=5e-5)


def test_the_x_axis_of_the_camera_points_up(demo):
    robot = demo.robot("FR")
    level = np.radians([0, -90, 90, 0, 0, 0])
    camera = robot.model.frame(level, "camera")
    assert np.allclose(camera.R[:, 2], [1, 0, 0], atol=1e-12)
    assert np.allclose(camera.R[:, 0], [0, 0, 1], atol=1e-12)


def test_the_planar_arm_stays_in_its_plane(planar):
    robot = planar.robots[0]
    assert robot.model.frame([0, 0, 0], "tool0").t == pytest.approx([1.2, 0, 0.5])
    assert robot.model.frame([0, np.pi / 2, 0], "tool0").t == pytest.approx([0.5, 0.7, 0.5])


# --- any model --------------------------------------------------------------------------------------------


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_frames_agree_with_those_in_the_tree_of_the_urdf(demo, seed):
    q_rng = np.random.default_rng(seed)
    for robot in demo.robots:
        q = sample(robot.model, q_rng)
        for name in robot.model.frame_names:
            frame, expected = robot.model.frame(q, name), frame_in_tree(robot.model, robot.urdf, q, name)
            assert np.allclose(frame.R, expected.R, atol=1e-9)
            assert np.allclose(frame.t, expected.t, atol=1e-9)


def test_tree_with_fixed_joints_and_a_tilted_base(tree):
    q = np.array([0.4, 0.3, -1.2])
    assert tree.parents == (-1, 0, 1)
    assert [body.joint for body in tree.bodies] == [-1, 1, 0, 2]
    assert tree.chain.tolist() == [[0, 0, 0], [1, 1, 0], [1, 0, 0], [1, 1, 1]]
    for name in tree.frame_names:
        assert np.allclose(tree.frame(q, name).t, frame_in_tree(tree, TREE, q, name).t)
    assert (tree.frame_joint("plate"), tree.frame_joint("left"), tree.frame_joint("tip")) == (-1, 0, 2)


def test_bodies_are_placed_on_their_links(models, demo):
    rng = np.random.default_rng(1)
    for model, text in zip(models, (TREE, *(r.urdf for r in demo.robots)), strict=False):
        q = sample(model, rng)
        R, t = model.body_placements(q)
        for i, body in enumerate(read_urdf(text).bodies):
            expected = model.frame(q, body.link) @ body.placement
            assert np.allclose(R[i], expected.R, atol=1e-12)
            assert np.allclose(t[i], expected.t, atol=1e-12)


def test_body_placements_are_not_overwritten(tree):
    first = tree.body_placements([0.1, 0.2, 0.3])
    copies = [array.copy() for array in first]
    tree.body_placements([1.0, 0.5, -2.0])
    assert all(np.array_equal(a, b) for a, b in zip(first, copies, strict=True))


def test_frame_jacobian_against_finite_differences(models):
    rng = np.random.default_rng(2)
    step = 1e-6
    for model in models:
        q = sample(model, rng)
        for name in model.frame_names:
            J = model.frame_jacobian(q, name)
            assert J.shape == (6, model.n)
            here = model.frame(q, name)
            for j, unit in enumerate(np.eye(model.n)):
                ahead, behind = model.frame(q + step * unit, name), model.frame(q - step * unit, name)
                spin = (ahead.R - behind.R) @ here.R.T / (2 * step)
                angular = [spin[2, 1], spin[0, 2], spin[1, 0]]
                assert np.allclose(J[:3, j], (ahead.t - behind.t) / (2 * step), atol=1e-7)
                assert np.allclose(J[3:, j], angular, atol=1e-7)


def test_point_jacobian_against_finite_differences(models):
    rng = np.random.default_rng(3)
    step = 1e-6
    for model in models:
        q = sample(model, rng)
        R, t = model.body_placements(q)
        for i, body in enumerate(model.bodies):
            local = rng.uniform(-0.5, 0.5, 3)
            J = model.point_jacobian(q, body.joint, R[i] @ local + t[i])
            for j, unit in enumerate(np.eye(model.n)):
                (Ra, ta), (Rb, tb) = (model.body_placements(q + s * step * unit) for s in (1, -1))
                slope = (Ra[i] @ local + ta[i] - Rb[i] @ local - tb[i]) / (2 * step)
                assert np.allclose(J[:, j], slope, atol=1e-7)
            assert not J[:, ~model.chain[i]].any()


def test_pinocchio_model_includes_the_base(tree):
    import pinocchio as pin

    q = np.array([0.4, 0.3, -1.2])
    pin.framesForwardKinematics(tree.pin_model, tree.pin_data, q)
    for name in ("plate", "tip"):
        oMf = tree.pin_data.oMf[tree.pin_model.getFrameId(name)]
        assert np.allclose(oMf.translation, tree.frame(q, name).t)


def test_arrays_are_read_only(tree):
    for array in (tree.lower, tree.upper, tree.velocity, tree.chain):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_queries_for_unknown_frames_joints_and_wrong_q_are_refused(tree):
    with pytest.raises(ModelError, match="there is no frame 'nose'; expected one of root, plate"):
        tree.frame([0, 0, 0], "nose")
    with pytest.raises(ModelError, match="there is no frame 'nose'"):
        tree.frame_joint("nose")
    with pytest.raises(ModelError, match=r"q has the shape \(2,\); expected 3 numbers"):
        tree.body_placements([0, 0])
    with pytest.raises(ModelError, match=r"there is no joint 3; expected -1 \(base\) to 2"):
        tree.point_jacobian([0, 0, 0], 3, [0, 0, 0])


def test_a_robot_without_moving_joint_is_refused():
    with pytest.raises(ModelError, match="no joint that moves"):
        RobotModel.from_urdf('<robot name="r"><link name="a"/></robot>', BASE)


def test_continuous_joints_are_refused_before_pinocchio_reads_them():
    with pytest.raises(ModelError, match="joint 'L': type 'continuous' is not supported"):
        RobotModel.from_urdf(TREE.replace('"L" type="revolute"', '"L" type="continuous"'), BASE)


def test_errors_of_pinocchio_become_model_errors(monkeypatch):
    def refuse(text):
        raise ValueError("no")

    monkeypatch.setattr("pinocchio.buildModelFromXML", refuse)
    with pytest.raises(ModelError, match="pinocchio refuses the URDF: no"):
        RobotModel.from_urdf(TREE, BASE)


@pytest.mark.parametrize("change", [('name="tree"', ""), ('"T"', '"tip"'), ('"root"', '"universe"')])
def test_names_that_pinocchio_uses_are_allowed(tree, change):
    same = RobotModel.from_urdf(TREE.replace(*change), BASE)
    q = [0.4, 0.3, -1.2]
    assert np.array_equal(same.frame(q, "tip").t, tree.frame(q, "tip").t)


def test_a_copy_of_a_model_has_results_of_its_own(tree):
    q, other = np.array([0.3, 0.1, -0.5]), np.array([-1.0, 0.4, 2.0])
    for copied in (copy.deepcopy(tree), pickle.loads(pickle.dumps(tree))):
        expected = tree.body_placements(q)[1]
        np.testing.assert_array_equal(copied.body_placements(other)[1], tree.body_placements(other)[1])
        np.testing.assert_array_equal(copied.body_placements(q)[1], expected)
        assert not copied.lower.flags.writeable

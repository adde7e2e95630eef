"""Tests of strict reading of robot descriptions: unknown content, errors reported together, warnings."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from armgate.cell.cell import build_cell
from armgate.cell.cell_warnings import cell_warnings
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError, ModelError
from armgate.cell.model import RobotModel
from armgate.cell.placement import Placement, rotation_from_rpy
from armgate.cell.urdf import parse_xml, read_robot, read_urdf
from armgate.cell.urdf.vocabulary import FORMS
from support import meshes

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="1"/>'


def urdf(base=BOX, arm=BOX, joint=LIMIT, more="", attributes="", kind="revolute"):
    """Return a URDF with lines 1: robot, 2: base, 3: arm, 4: tool0, 5: joint J, 6: its mount, 7: more."""
    return f"""<robot name="r" {attributes}>
<link name="base">{base}</link>
<link name="arm">{arm}</link>
<link name="tool0"/>
<joint name="J" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>{joint}</joint>
<joint name="M" type="fixed"><parent link="arm"/><child link="tool0"/></joint>
{more}</robot>"""


def cell_of(tmp_path, text, post=True, **own):
    return build_cell(load_config([cell_file(tmp_path, text, post, **own)]))


def cell_file(tmp_path, text, post=True, **own):
    (tmp_path / "r.urdf").write_bytes(text if isinstance(text, bytes) else text.encode())
    cell = {"armgate": 1, "name": "c", "robots": {"R": {"urdf": "r.urdf", "start": [0.0]} | own}}
    if post:
        cell["surroundings"] = {"post": {"shape": {"sphere": 0.1}, "xyz": [3, 0, 0]}}
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(cell, sort_keys=False))
    return path


# --- refused by name ----------------------------------------------------------------------------------------

HALF = "0 0.7071067811865476 0 0.7071067811865476"
ORIGIN = BOX.replace("<geometry>", "<origin {}/><geometry>")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (urdf(more='<xacro:gripper parent="tool0"/>'), "line 7: <xacro:gripper> is left over from xacro"),
        (urdf(base='<visual><xacro:if value="1"/></visual>'), "line 2: <xacro:if> is left over from xacro"),
        (urdf(attributes='xmlns:x="http://www.ros.org/wiki/xacro"', more="<x:arm/>"), "<x:arm> is left over"),
        (urdf(more="<loop_joint/>"),
         "line 7: <loop_joint> in <robot> is not supported; expected link, joint"),
        (urdf(base="<self_collision_checking/>"),
         "visual, inertial, contact: remove it; the shapes in <collision> are checked"),
        (urdf(base="<colision/>"), "line 2: link 'base': <colision> in <link> is not supported"),
        (urdf(arm=BOX.replace("</geometry>", "</geometry><surface/>")), "line 3: link 'arm': <surface>"),
        (urdf(arm=BOX.replace("<geometry>", "<origin/><origin/><geometry>")),
         "<origin> occurs again in <collision>"),
        (urdf(arm=BOX.replace("<geometry>", "<geometry/><geometry>")),
         "<geometry> occurs again in <collision>"),
        (urdf(joint=LIMIT * 2), "line 5: joint 'J': <limit> occurs again in <joint>; expected it once"),
        (urdf(joint=LIMIT.replace("lower", "drake:acceleration='2' lower")),
         "line 5: joint 'J': the attribute 'drake:acceleration' of <limit> is not supported; expected lower"),
        (urdf(joint=LIMIT.replace("lower", "lowr='2' lower")),
         "the attribute 'lowr' of <limit> is not supported"),
        (urdf(arm=ORIGIN.format('xyz="0 0 0" yaw="1"')), "the attribute 'yaw' of <origin> is not supported"),
        (urdf(arm=BOX.replace("size", "scale='2 2 2' size")),
         "the attribute 'scale' of <box> is not supported"),
        (urdf(base="text"), "line 2: link 'base': text in <link>; expected elements and attributes only"),
        (urdf(attributes='version="2.0"'),
         "line 1: version '2.0' of URDF is not known; expected one of 1.0, 1.1, 1.2"),
        (urdf(arm=ORIGIN.format(f'quat_xyzw="{HALF}"')), 'quat_xyzw needs <robot version="1.1">'),
        (urdf(arm=ORIGIN.format(f'rpy="0 0 1" quat_xyzw="{HALF}"'), attributes='version="1.1"'),
         "<origin> has rpy and quat_xyzw; expected one of them"),
        (urdf(arm=ORIGIN.format('quat_xyzw="0 0 0 2"'), attributes='version="1.1"'), "quat_xyzw of length 2"),
        (urdf(arm=ORIGIN.format('quat_xyzw="0 0 0"'), attributes='version="1.1"'),
         "expected 4 finite number(s)"),
        (urdf(joint=LIMIT.replace("lower", 'deceleration="0" lower')),
         "deceleration limit 0; expected more than 0"),
        (urdf(joint=LIMIT.replace("lower", 'acceleration="nan" lower')), "acceleration='nan' in <limit>"),
        (urdf(joint=LIMIT + '<mimic joint="K"/>'), "line 5: joint 'J': <mimic> joints are not supported"),
        (urdf(arm=BOX.replace("box size=", "ellipsoid size=")),
         "line 3: link 'arm', body 'arm': unknown shape <ellipsoid>"),
        (urdf(arm=BOX.replace("<collision>", '<collision name="x">') * 2), "line 3: body 'x' occurs twice"),
        ("<robot>" + "<link>" * 100 + "</link>" * 100 + "</robot>", "nested deeper"),
        ('<!DOCTYPE robot [<!ENTITY a "b">]>' + urdf(), "a document type or entities are not allowed"),
    ],
)  # fmt: skip
def test_unknown_content_is_refused_by_name_and_line(text, message):
    with pytest.raises(ModelError, match=re.escape(message)):
        read_urdf(text)


@pytest.mark.parametrize("kind", ["continuous", "floating", "planar", "screw"])
def test_joints_of_other_kinds_are_refused_by_name(kind):
    with pytest.raises(ModelError, match=f"line 5: joint 'J': type '{kind}' is not supported"):
        read_urdf(urdf(kind=kind))


def test_ignored_content_changes_nothing():
    ignored = {
        tag: "".join(f"<{child}><any thing='1'>text</any></{child}>" for child in form.ignored)
        for tag, form in FORMS.items()
    }
    text = urdf(
        base=BOX.replace("</collision>", ignored["collision"] + "</collision>") + ignored["link"],
        joint=LIMIT.replace("effort", 'jerk="9" effort') + ignored["joint"],
        more=ignored["robot"],
        attributes='version="1.2" xmlns:xacro="http://www.ros.org/wiki/xacro" xml:space="default"',
    )
    assert repr(read_urdf(text)) == repr(read_urdf(urdf()))


def test_the_documentation_lists_the_ignored_content():
    page = (Path(__file__).parents[2] / "docs" / "configuration.md").read_text()
    table = page.partition("### What is ignored in a URDF\n")[2].partition("\n#")[0]
    for tag, form in FORMS.items():
        for name in (*form.ignored, *form.ignored_attributes):
            assert f"`{name}`" in table, (tag, name)


# --- read ---------------------------------------------------------------------------------------------------


def test_quaternions_of_collisions_and_joints_are_read():
    rng = np.random.default_rng(0)
    for _ in range(20):
        place = Placement.from_quaternion((0.1, 0.2, 0.3), rng.normal(size=4))
        quat = " ".join(map(repr, place.xyzw()))
        text = urdf(
            arm=ORIGIN.format(f'quat_xyzw="{quat}"'),
            joint=LIMIT + f'<origin quat_xyzw="{quat}"/>',
            attributes='version="1.1"',
        )
        found = read_urdf(text)
        assert np.allclose(found.bodies[1].placement.R, place.R, atol=1e-15)
        assert np.allclose(found.joints[0].origin.R, place.R, atol=1e-15)
        model = RobotModel.from_urdf(text, Placement.identity())
        assert np.allclose(model.frame([0.0], "arm").R, place.R, atol=1e-14)


def test_rpy_of_a_rotation_gives_the_rotation_back():
    rng = np.random.default_rng(1)
    steep = [(0.3, s * np.pi / 2, 0.4) for s in (-1, 1)] + [
        (0.3, np.pi / 2 - 10.0**-k, 1) for k in range(6, 12)
    ]
    for rpy in [*rng.uniform(-3.2, 3.2, (200, 3)), *steep]:
        R = rotation_from_rpy(rpy)
        assert np.abs(rotation_from_rpy(Placement(R, np.zeros(3)).rpy()) - R).max() < 1e-8


@pytest.mark.parametrize(
    ("limits", "joints", "found"),
    [
        ("", {}, (8.0, 8.0)),
        ('acceleration="0.5" deceleration="0.25"', {}, (0.5, 0.25)),
        ('acceleration="0.5"', {}, (0.5, 0.5)),
        ('deceleration="0.5"', {}, (8.0, 0.5)),
        ('acceleration="50" deceleration="50"', {}, (8.0, 8.0)),
        ('acceleration="50" deceleration="50"', {"J": {"deceleration": 20}}, (8.0, 20.0)),
        ("", {"J": {"deceleration": None}}, (8.0, np.inf)),
    ],
)
def test_accelerations_of_the_urdf_are_bounds(tmp_path, limits, joints, found):
    text = urdf(joint=LIMIT.replace("effort", f"{limits} effort"))
    robot = cell_of(tmp_path, text, joints=joints).robots[0]
    assert (robot.acceleration[0], robot.deceleration[0]) == found


@pytest.mark.parametrize("own", [{"acceleration": 1}, {"deceleration": 1}, {"deceleration": None}])
def test_accelerations_looser_than_the_urdfs_are_refused(tmp_path, own):
    text = urdf(joint=LIMIT.replace("effort", 'acceleration="0.5" deceleration="0.5" effort'))
    with pytest.raises(ConfigError, match=r"joints\.J\..*looser than the URDF's 0\.5"):
        cell_of(tmp_path, text, joints={"J": own})


def test_several_links_may_use_the_same_name_for_a_collision(tmp_path):
    named = BOX.replace("<collision>", '<collision name="hull">')
    cell = cell_of(tmp_path, urdf(named, named + BOX), ignore_pairs=[["arm.hull", "post"]])
    assert [body.name for body in cell.bodies] == ["R/base.hull", "R/arm.hull", "R/arm_2", "post"]
    assert [cell.bodies[pair.a].name for pair in cell.pairs] == ["R/arm_2"]


def test_the_default_name_of_a_collision_avoids_given_names(tmp_path):
    named = BOX.replace("<collision>", '<collision name="{}">')
    cell = cell_of(tmp_path, urdf("", named.format("arm_2") + BOX + named.format("arm")))
    assert [body.name for body in cell.bodies] == ["R/arm_2", "R/arm_2_", "R/arm", "post"]


# --- all errors together, before any slow step --------------------------------------------------------------


def test_all_errors_are_reported_together_before_a_mesh_is_cut(tmp_path, monkeypatch):
    from armgate.cell.mesh import convex_parts

    def never(*_):
        raise AssertionError("a mesh was cut")

    monkeypatch.setattr(convex_parts, "decompose", never)
    (tmp_path / "a.stl").write_bytes(meshes.stl(*meshes.blocks(meshes.BAR, (0, 1), (0, 1), (0, 1))))
    (tmp_path / "cut.stl").write_bytes(meshes.stl(*meshes.blocks(meshes.BAR, (0, 1), (0, 1), (0, 1)))[:-9])
    mesh = '<collision><geometry><mesh filename="{}"/></geometry></collision>'
    text = urdf(mesh.format("a.stl"), mesh.format("cut.stl") + mesh.format("none.stl"))
    wrong = {"tool": "hand", "joints": {"K": {"lower": 0}}, "start": [0.0, 0.0]}
    with pytest.raises(ConfigError) as error:
        cell_of(tmp_path, text.replace("</robot>", "<joint name='K' type='planar'/></robot>"), **wrong)
    for part in ("there is no frame 'hand'", "type 'planar' is not supported"):
        assert part in str(error.value)
    with pytest.raises(ConfigError) as error:
        cell_of(tmp_path, text, **wrong)
    for part in (
        "there is no frame 'hand'",
        "cut.stl: binary STL of 675 bytes",
        "there is no file",
        "line 3: link",
    ):
        assert part in str(error.value)
    with pytest.raises(ConfigError) as error:
        cell_of(tmp_path, urdf(mesh.format("a.stl")), **wrong)
    for part in (
        "there is no frame 'hand'",
        "R.joints.K: robot R has no joint",
        "R.start: 2 values; expected 1",
    ):
        assert part in str(error.value)
    assert len(str(error.value).splitlines()) == 3


def test_more_than_ten_errors_are_counted(tmp_path):
    many = "".join(f"<a{i}/>" for i in range(30))
    with pytest.raises(ConfigError) as error:
        cell_of(tmp_path, urdf(more=many))
    lines = str(error.value).splitlines()
    assert (len(lines), lines[-1]) == (11, "… and 20 more")


# --- warnings -----------------------------------------------------------------------------------------------

VISUAL = BOX.replace("collision", "visual")


def test_parts_without_collision_bodies_give_warnings(tmp_path):
    assert cell_warnings(cell_of(tmp_path, urdf())) == []
    (seen, still) = (
        cell_warnings(cell_of(tmp_path, urdf(arm=VISUAL))),
        cell_warnings(cell_of(tmp_path, urdf(base=VISUAL))),
    )
    assert "R: no moving link has a body" in seen[0]
    assert "R: link arm has visuals but no collision body" in seen[1]
    assert ["R: link base has visuals" in text for text in still] == [True]
    extra = {"bodies": {"hull": {"link": "arm", "shape": {"sphere": 0.1}}}}
    assert cell_warnings(cell_of(tmp_path, urdf(arm=VISUAL), **extra)) == []
    (jerk,) = cell_warnings(cell_of(tmp_path, urdf(joint=LIMIT.replace("effort", 'jerk="9" effort'))))
    assert "R: joint J has a jerk limit, which the gate ignores" in jerk


def test_a_cell_without_pairs_gives_a_warning(tmp_path):
    (text,) = cell_warnings(cell_of(tmp_path, urdf(), post=False))
    assert "no pair of bodies must stay apart" in text


def test_line_numbers_are_those_of_the_file():
    root = parse_xml(urdf())
    assert [element.line for element in root] == [2, 3, 4, 5, 6]
    assert read_robot(root).root == "base"


@pytest.mark.parametrize("number", ["-1_0", "-١", "-１", "0x1", "-1\u00a0", "1.", ".5", "-1e0"])
def test_numbers_are_ascii_decimal_numbers(number):
    text = urdf(joint=LIMIT.replace('"-1"', f'"{number}"'), arm=BOX)
    if number in ("1.", ".5", "-1e0"):
        assert read_urdf(text.replace('upper="1"', 'upper="5"')).joints[0].lower == float(number)
        return
    with pytest.raises(ModelError, match=r"line 5: joint 'J': lower=.* expected 1 finite number"):
        read_urdf(text)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "cp500", "latin-1"])
def test_files_in_other_encodings_are_refused_with_their_line(tmp_path, encoding):
    data = urdf(more="<!-- ä -->").encode(encoding)
    with pytest.raises(ConfigError, match=r"r.urdf: line \d: .*expected UTF-8: save the file as UTF-8"):
        cell_of(tmp_path, data)


def test_a_byte_order_mark_of_utf_8_is_read(tmp_path):
    assert cell_of(tmp_path, urdf().encode("utf-8-sig")).robots[0].model.n == 1


def test_pipes_are_refused_as_a_urdf(tmp_path):
    path = cell_file(tmp_path, urdf())
    (tmp_path / "r.urdf").unlink()
    os.mkfifo(tmp_path / "r.urdf")
    with pytest.raises(ConfigError, match=r"r.urdf cannot be read: it is a device or pipe"):
        build_cell(load_config([path]))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("file://[a/x.stl", "not a URI"),
        ("a" * 5000 + ".stl", "there is no file /"),
        ("file:///a%00.stl", "there is no file"),
        ("package://../x.stl", "package '..' is not known"),
    ],
)
def test_impossible_file_names_of_meshes_are_refused(tmp_path, name, reason):
    arm = BOX.replace('<box size="0.1 0.1 0.1"/>', f'<mesh filename="{name}"/>')
    with pytest.raises(ConfigError, match=re.escape(reason)) as caught:
        cell_of(tmp_path, urdf(arm=arm))
    assert "line 3: link 'arm', body 'arm': " in str(caught.value)
    assert len(str(caught.value)) < 1000


def test_descriptions_with_too_many_elements_are_refused_at_once(tmp_path):
    links = "".join(f'<link name="l{number}"/>' for number in range(50_000))
    with pytest.raises(ConfigError, match="50003 elements <link>; expected at most 256: simplify") as caught:
        cell_of(tmp_path, urdf(more=links))
    assert len(str(caught.value)) < 500


def test_a_robot_has_at_most_as_many_moving_joints_as_the_protocol_describes():
    chain = "".join(
        f'<link name="l{number}"/><joint name="j{number}" type="revolute"><parent link="base"/>'
        f'<child link="l{number}"/>{LIMIT}</joint>'
        for number in range(64)
    )
    with pytest.raises(ModelError, match="65 joints that move; expected at most 64"):
        RobotModel.from_urdf(urdf(more=chain), Placement.identity())


def test_convex_bodies_with_too_many_corners_are_refused():
    corners = " ".join(f"{number % 10} {number // 10 % 10} {number // 100}" for number in range(5000))
    convex = BOX.replace('<box size="0.1 0.1 0.1"/>', f'<convex vertices="{corners}"/>')
    with pytest.raises(ModelError, match="5000 corners of a convex body; expected at most 4096"):
        read_urdf(urdf(arm=convex))


def test_mesh_options_for_unknown_bodies_are_refused_without_meshes_too(tmp_path):
    with pytest.raises(ConfigError, match=r"meshes.bodies names 'elbow', but the URDF has no such link"):
        cell_of(tmp_path, urdf(), meshes={"bodies": {"elbow": {"method": "hull"}}})

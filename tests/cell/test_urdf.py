import numpy as np
import pytest

from armgate.cell.errors import ModelError
from armgate.cell.shapes import Box, Capsule, Cylinder, Sphere
from armgate.cell.urdf import parse_xml, read_urdf
from armgate.cell.urdf.normalize import kinematics_only

JOINT = """
<joint name="J" type="revolute"><parent link="a"/><child link="b"/><origin xyz="1 2 3" rpy="0 0 0.5"/>
<axis xyz="0 0 2"/><limit lower="-1" upper="1" velocity="2" effort="9"/></joint>"""


def robot(joint: str = JOINT, body: str = "", more: str = "") -> str:
    return f'<robot name="r"><link name="a">{body}</link><link name="b"/>{joint}{more}</robot>'


def body(geometry: str, name: str = "", origin: str = "") -> str:
    return f"<collision{name}>{origin}<geometry>{geometry}</geometry></collision>"


def test_joints_are_read():
    urdf = read_urdf(robot())
    (joint,) = urdf.joints
    assert (urdf.name, urdf.root, urdf.links) == ("r", "a", ("a", "b"))
    assert (joint.name, joint.kind, joint.parent, joint.child) == ("J", "revolute", "a", "b")
    assert joint.axis == (0.0, 0.0, 1.0)
    assert (joint.lower, joint.upper, joint.velocity) == (-1.0, 1.0, 2.0)
    assert np.allclose(joint.origin.t, [1, 2, 3])


@pytest.mark.parametrize(
    ("geometry", "shape"),
    [
        ('<sphere radius="0.1"/>', Sphere(0.1)),
        ('<capsule radius="0.1" length="0.5"/>', Capsule(0.1, 0.5)),
        ('<cylinder radius="0.1" length="0.5"/>', Cylinder(0.1, 0.5)),
        ('<box size="1 2 3"/>', Box(1, 2, 3)),
    ],
)
def test_bodies_are_read(geometry, shape):
    (found,) = read_urdf(robot(body=body(geometry, origin='<origin xyz="0 1 0"/>'))).bodies
    assert (found.name, found.link, found.shape) == ("a", "a", shape)
    assert np.allclose(found.placement.t, [0, 1, 0])


def test_bodies_are_named_by_collision_or_link():
    sphere = '<sphere radius="1"/>'
    text = robot(body=body(sphere) + body(sphere, ' name="own"') + body(sphere))
    assert [found.name for found in read_urdf(text).bodies] == ["a", "own", "a_3"]


def test_kinematics_only_removes_everything_else():
    clutter = "<visual/><inertial/>"
    text = robot(
        JOINT.replace(' effort="9"', ""), body('<capsule radius="1" length="1"/>') + clutter, "<gazebo/>"
    )
    stripped = kinematics_only(text)
    assert "capsule" not in stripped
    assert not any(tag in stripped for tag in ("visual", "inertial", "gazebo"))
    assert 'effort="0"' in stripped
    assert read_urdf(stripped).joints[0].name == "J"


def joint(kind: str = "revolute", inner: str = '<limit lower="-1" upper="1" velocity="2"/>') -> str:
    return f'<joint name="J" type="{kind}"><parent link="a"/><child link="b"/>{inner}</joint>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (robot(joint("continuous")), "joint 'J': type 'continuous' is not supported; make it revolute"),
        (robot(joint("floating")), "joint 'J': type 'floating' is not supported; expected revolute"),
        (robot(joint("planar")), "joint 'J': type 'planar' is not supported"),
        (robot(joint("spherical")), "joint 'J': type 'spherical' is not supported"),
        (robot(joint(inner='<mimic joint="K"/>')), "joint 'J': <mimic> joints are not supported"),
        (robot(joint(inner="")), "joint 'J': lacks <limit"),
        (robot(joint(inner='<limit lower="1" upper="1" velocity="2"/>')), "lower limit 1 is not below"),
        (robot(joint(inner='<limit lower="0" upper="1" velocity="0"/>')), "velocity limit 0; expected more"),
        (robot(joint(inner='<limit lower="0" upper="nan" velocity="1"/>')), "upper='nan' in <limit>"),
        (robot(joint(inner='<limit lower="0" upper="1"/>')), "<limit> lacks the attribute 'velocity'"),
        (robot(JOINT.replace("0 0 2", "0 0 0")), "its axis is zero"),
        (robot(JOINT.replace("0 0 2", "0 0")), "xyz='0 0' in <axis>; expected 3 finite"),
        (robot(JOINT.replace("1 2 3", "1 2 x")), "xyz='1 2 x' in <origin>; expected 3 finite"),
        (robot(JOINT.replace('child link="b"', 'child link="c"')), "its child link 'c' does not exist"),
        (robot(JOINT.replace('<parent link="a"/>', "")), "joint 'J': lacks <parent"),
        (robot(JOINT + JOINT), "joint 'J' occurs twice"),
        (robot(JOINT + JOINT.replace('"J"', '"K"')), "child link 'b' occurs twice"),
        (robot(more='<link name="a"/>'), "link 'a' occurs twice"),
        (robot(more='<link name="c"/>'), "links a, c have no parent; expected exactly one root"),
        (robot(more='<link name="b c"/>'), "a link cannot be called 'b c'"),
        ('<robot name="r"/>', "there is no <link>"),
        ("<model/>", "the outer element is <model>; expected <robot>"),
        ("<robot", "not well-formed XML"),
        ('<!DOCTYPE r [<!ENTITY x "y">]><robot/>', "a document type or entities are not allowed"),
        (robot(body=body('<mesh filename="x.stl"/>')), "link 'a', body 'a': <mesh> refers to a file"),
        (robot(body=body('<torus radius="1"/>')), "link 'a', body 'a': unknown shape <torus>; expected"),
        (robot(body=body('<sphere radius="-1"/>')), "a sphere cannot have the size -1.0"),
        (robot(body=body('<sphere radius="inf"/>')), "radius='inf' in <sphere>"),
        (robot(body=body('<sphere r="1"/>')), "<sphere> lacks the attribute 'radius'"),
        (robot(body=body("")), "expected one <geometry> with one shape"),
        (robot(body="<collision/>"), "expected one <geometry> with one shape"),
        (robot(body=body('<sphere radius="1"/>', ' name="b c"')), "a body cannot be called 'b c'"),
        (robot(body=body('<sphere radius="1"/>', ' name="x"') * 2), "body 'x' occurs twice"),
    ],
)
def test_errors_are_reported_by_name(text, message):
    with pytest.raises(ModelError) as caught:
        read_urdf(text)
    assert message in str(caught.value)


def test_loops_are_refused():
    back = (
        JOINT.replace('"J"', '"K"')
        .replace('parent link="a"', 'parent link="b"')
        .replace('child link="b"', 'child link="a"')
    )
    with pytest.raises(ModelError, match="the joints form a loop; expected a tree"):
        read_urdf(robot(JOINT + back))
    aside = '<link name="c"/><link name="d"/>' + "".join(
        f'<joint name="{n}" type="fixed"><parent link="{p}"/><child link="{c}"/></joint>'
        for n, p, c in (("K", "c", "d"), ("L", "d", "c"))
    )
    with pytest.raises(ModelError, match="links c, d are not connected to a"):
        read_urdf(robot(more=aside))


def test_parse_xml_returns_the_robot():
    assert parse_xml(robot()).get("name") == "r"

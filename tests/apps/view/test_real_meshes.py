"""Real meshes from a package like rtb-data: the arm's URDF, and a Collada file for each link."""

import shutil
from importlib.machinery import ModuleSpec

import collada
import numpy as np
import pytest

from armgate.apps.view import colours, real_meshes
from armgate.apps.view.scene import Scene

from .conftest import DEMO, described

LINKS = ("base_link", *(f"link_{n}" for n in range(1, 7)))
CORNERS = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0], [0, 0, 0.3]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def write(file, colour):
    """Write a Collada file with a tetrahedron of this colour."""
    made = collada.Collada()
    effect = collada.material.Effect("effect", [], "phong", diffuse=colour)
    paint = collada.material.Material("paint", "paint", effect)
    made.effects.append(effect)
    made.materials.append(paint)
    points = collada.source.FloatSource("points", CORNERS.ravel(), ("X", "Y", "Z"))
    shape = collada.geometry.Geometry(made, "shape", "shape", [points])
    inputs = collada.source.InputList()
    inputs.addInput(0, "VERTEX", "#points")
    shape.primitives.append(shape.createTriangleSet(FACES.ravel(), inputs, "paint"))
    made.geometries.append(shape)
    node = collada.scene.GeometryNode(shape, [collada.scene.MaterialNode("paint", paint, inputs=[])])
    made.scenes.append(collada.scene.Scene("scene", [collada.scene.Node("node", children=[node])]))
    made.scene = made.scenes[0]
    with file.open("wb") as stream:
        made.write(stream)


@pytest.fixture
def package(tmp_path, monkeypatch):
    arm = tmp_path / "xacro" / "kuka_description" / "kuka_kr16"
    visual = arm / "meshes" / "kr16_2" / "visual"
    visual.mkdir(parents=True)
    (arm / "urdf").mkdir()
    shutil.copy(DEMO.parent / "robots" / "kr16.urdf", arm / "urdf" / "kr16_2.urdf")
    for link in LINKS:
        write(visual / f"{link}.dae", (0.0, 0.0, 0.0, 1.0) if link == "base_link" else (0.5, 0.2, 0.1, 1.0))
    spec = ModuleSpec("rtbdata", None, origin=str(tmp_path / "__init__.py"))
    real = real_meshes.find_spec
    monkeypatch.setattr(real_meshes, "find_spec", lambda name: spec if name == "rtbdata" else real(name))
    return arm


def test_known_arms_get_real_meshes_and_keep_added_bodies(package, cell):
    scene = Scene.build(*described(cell))
    for robot in scene.robots:
        for link in LINKS:
            (piece,) = robot.pieces[link]
            assert piece.colour == (colours.BLACK if link == "base_link" else piece.colour)
            assert piece.mesh.vertices.max(axis=0) == pytest.approx([0.3] * 3)
    follower, leader = scene.robots
    assert {piece.colour for piece in follower.pieces["link_2"]} == {colours.ARM}
    assert any(len(piece.mesh.edges) for piece in follower.pieces["tool0"])  # the camera's housing
    assert "gantry_x" in leader.pieces


def test_other_arms_keep_their_primitives(package, cell):
    urdf = cell.robots[0].urdf
    assert set(real_meshes.real_meshes(urdf)) == set(LINKS)
    assert real_meshes.real_meshes(urdf.replace('xyz="0.68 0 0"', 'xyz="0.70 0 0"')) == {}
    assert real_meshes.real_meshes(urdf.replace("link_3", "elbow")) == {}


def test_without_the_extra_there_are_no_real_meshes(cell, monkeypatch):
    monkeypatch.setattr(real_meshes, "find_spec", lambda name: None)
    assert real_meshes.real_meshes(cell.robots[0].urdf) == {}

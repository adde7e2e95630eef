import numpy as np
import pytest

from armgate.apps.view.shapes import convex, joined, mesh_of
from armgate.cell.placement import Placement
from armgate.cell.shapes import shape_from

SIZES = {
    "box": (0.3, 0.2, 0.5),
    "sphere": (0.2,),
    "capsule": (0.1, 0.4),
    "cylinder": (0.1, 0.4),
    "cone": (0.2, 0.3),
}
VOLUMES = {
    "box": 0.03,
    "sphere": 4 / 3 * np.pi * 0.008,
    "capsule": np.pi * 0.01 * 0.4 + 4 / 3 * np.pi * 0.001,
    "cylinder": np.pi * 0.01 * 0.4,
    "cone": np.pi * 0.04 * 0.3 / 3,
}


def volume(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


@pytest.mark.parametrize("kind", SIZES)
def test_surface_points_lie_on_the_shape(kind):
    mesh = mesh_of(kind, SIZES[kind])
    shape = shape_from(kind, SIZES[kind])
    # Closed and wound outward: its signed volume is the shape's, up to the corners of round shapes.
    assert volume(mesh) == pytest.approx(VOLUMES[kind], rel=0.03)
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(shape.bounding_radius)
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    solid = np.linalg.norm(across, axis=1) > 1e-12
    normals = mesh.normals[mesh.faces].mean(axis=1)
    assert np.all(np.einsum("ij,ij->i", across, normals)[solid] > 0.0)
    assert np.all(np.einsum("ij,ij->i", across, middle)[solid] > -1e-9)


def test_a_hull_has_creases_and_moves():
    box = mesh_of("box", (1.0, 1.0, 1.0))
    corners, index = np.unique(box.vertices, axis=0, return_inverse=True)
    hull = convex(corners, index.reshape(-1)[box.faces])
    assert volume(hull) == pytest.approx(1.0)
    assert len(hull.edges) == 12  # diagonals of the sides are not edges
    moved = joined([hull, hull]).at(Placement(np.eye(3), np.array([0.0, 0.0, 2.0])))
    assert moved.vertices[:, 2].min() == pytest.approx(1.5)
    assert volume(moved) == pytest.approx(2.0)


def test_an_unknown_shape_is_named():
    with pytest.raises(ValueError, match="torus"):
        mesh_of("torus", (1.0,))

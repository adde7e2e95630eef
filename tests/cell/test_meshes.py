"""Tests of meshes: containment in the parts (checked independently), files, packages, URDFs, errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.config.packing import load_packed, pack
from armgate.cell.errors import ConfigError, ModelError
from armgate.cell.mesh.convex_parts import convex_parts
from armgate.cell.mesh.decomposition.cutting import RAYS, Surface, directions, proven_outside, split
from armgate.cell.mesh.decomposition.decompose import DecompositionOptions, decompose
from armgate.cell.mesh.hull import JOGGLE, hull_of, thinned
from armgate.cell.mesh.locate import locate
from armgate.cell.mesh.triangle_mesh import read_mesh
from support import meshes

PARTS = DecompositionOptions("parts", 0.1, 16, 64)
HULL = replace(PARTS, method="hull")
UNIT = (1.0, 1.0, 1.0)


def mesh_of(vertices, faces):
    return read_mesh(meshes.obj(vertices, faces), "obj", UNIT)


def rotation(rng):
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def on_surface(mesh, rng, count):
    weights = rng.dirichlet((1, 1, 1), (count, len(mesh.faces)))
    return np.vstack([mesh.vertices, np.einsum("kfc,fci->kfi", weights, mesh.triangles).reshape(-1, 3)])


def contained(bodies, points, slack=0.0):
    """Return True for each point that lies in a body: inside all planes of its hull, moved by its radius."""
    inside = np.zeros(len(points), dtype=bool)
    for body in bodies:
        corners = np.array(body.vertices)
        normals = hull_of(corners).normals
        inside |= np.all(
            points @ normals.T <= (corners @ normals.T).max(axis=0) + body.radius + slack, axis=1
        )
    return inside


steps = st.floats(0.05, 0.3)
plans = st.sampled_from([meshes.ELL, meshes.U, meshes.FRAME, meshes.CROSS])


def blocks(plan, sizes):
    xs = np.cumsum([0.0, *sizes[: len(plan[0])]])
    ys = np.cumsum([0.0, *sizes[3 : 3 + len(plan)]])
    low = np.array([(xs[j], ys[i], 0.0) for i, row in enumerate(plan) for j, c in enumerate(row) if c == "#"])
    size = np.array(
        [
            (sizes[j], sizes[3 + i], sizes[6])
            for i, row in enumerate(plan)
            for j, c in enumerate(row)
            if c == "#"
        ]
    )
    return meshes.blocks(plan, xs, ys, (0.0, sizes[6])), low, size


@settings(max_examples=6, deadline=None)
@given(plans, st.lists(steps, min_size=7, max_size=7), st.integers(0, 10**6), st.booleans())
def test_parts_contain_the_surface_and_the_inside(plan, sizes, seed, turned):
    rng = np.random.default_rng(seed)
    (vertices, faces), low, size = blocks(plan, sizes)
    Q = rotation(rng) if turned else np.eye(3)
    mesh = mesh_of(vertices @ Q.T, faces)
    found = decompose(mesh, replace(PARTS, max_parts=int(rng.integers(1, 9))))
    inside = (low + size * rng.random((400, len(low), 3))).reshape(-1, 3) @ Q.T
    assert contained(found, on_surface(mesh, rng, 20)).all()
    assert contained(found, inside).all()


def test_parts_contain_everything_for_any_cuts(monkeypatch):
    """Cut at random planes: containment does not depend on the proposed planes."""
    from armgate.cell.mesh.decomposition.choose_planes import Plane

    rng = np.random.default_rng(3)
    (vertices, faces), low, size = blocks(meshes.FRAME, (0.1, 0.2, 0.1, 0.1, 0.15, 0.1, 0.2))
    for _ in range(15):
        Q = rotation(rng)
        mesh = mesh_of(vertices @ Q.T, faces)
        boxes, planes = [(mesh.vertices.min(axis=0), mesh.vertices.max(axis=0))], []
        for count in range(1, 9):
            k, axis = int(rng.integers(count)), int(rng.integers(3))
            low_end, high_end = boxes[k]
            at = float(rng.uniform(low_end[axis], high_end[axis]))
            across = np.arange(3) == axis
            boxes[k : k + 1] = [
                (low_end, np.where(across, at, high_end)),
                (np.where(across, at, low_end), high_end),
            ]
            planes.append(Plane(k, axis, at))
        monkeypatch.setattr(
            "armgate.cell.mesh.decomposition.decompose.propose_planes", lambda *given, planes=planes: planes
        )
        found = decompose(mesh, PARTS)
        inside = (low + size * rng.random((200, len(low), 3))).reshape(-1, 3) @ Q.T
        assert contained(found, on_surface(mesh, rng, 10)).all()
        assert contained(found, inside).all()


@pytest.mark.parametrize(
    ("plan", "count"), [(meshes.ELL, 2), (meshes.U, 3), (meshes.FRAME, 4), (meshes.CROSS, 3), (meshes.BAR, 1)]
)
def test_blocks_are_cut_into_their_convex_parts(plan, count):
    (vertices, faces), _, _ = blocks(plan, (0.1, 0.2, 0.1, 0.2, 0.1, 0.05, 0.1))
    found = decompose(mesh_of(vertices, faces), PARTS)
    assert len(found) == count
    total = sum(hull_volume(body) for body in found)
    assert total == pytest.approx(abs(meshes.volume(vertices, faces)), rel=1e-3)
    assert all(body.radius < 1e-8 for body in found)


def hull_volume(body):
    hull = hull_of(np.array(body.vertices))
    a, b, c = np.moveaxis(hull.vertices[hull.faces] - hull.vertices.mean(axis=0), 1, 0)
    return float(np.abs(np.einsum("fi,fi->f", a, np.cross(b, c))).sum() / 6)


@pytest.mark.slow
def test_the_parts_of_a_ring_leave_its_hole_open():
    vertices, faces = meshes.ring(0.3, 0.4, 0.1, 10)
    mesh, rng = mesh_of(vertices, faces), np.random.default_rng(3)
    found = decompose(mesh, replace(PARTS, threshold=0.3))
    assert len(found) <= PARTS.max_parts
    assert contained(found, on_surface(mesh, rng, 30)).all()
    assert not contained(found, np.array([[0.0, 0.0, 0.05], [0.2, 0.1, 0.05]])).any()
    assert found == decompose(mesh, replace(PARTS, threshold=0.3))
    few = decompose(mesh, replace(PARTS, max_parts=3))
    assert len(few) <= 3
    assert contained(few, on_surface(mesh, rng, 30)).all()


def test_a_fine_mesh_is_thinned_and_thickened_by_the_loss():
    mesh, rng = mesh_of(*meshes.ring(0.3, 0.4, 0.1, 400)), np.random.default_rng(4)
    (body,) = decompose(mesh, HULL)
    assert len(body.vertices) <= HULL.max_vertices
    assert 1e-4 < body.radius < 1e-2
    assert contained([body], on_surface(mesh, rng, 3)).all()


# --- parts of the proof -----------------------------------------------------------------------------------


@given(st.integers(0, 10**6))
@settings(max_examples=60, deadline=None)
def test_both_sides_of_a_cut_add_up_to_the_whole(seed):
    rng = np.random.default_rng(seed)
    triangles = rng.integers(-2, 3, (12, 3, 3)).astype(float)  # corners in the plane, edges, whole triangles
    axis, at = int(rng.integers(3)), float(rng.choice([-2, -1, 0, 0.5, 1, 2]))
    below, above = split(triangles, axis, at)
    assert np.all(below[:, :, axis] <= at)
    assert np.all(above[:, :, axis] >= at)
    flat = np.all(triangles[:, :, axis] == at, axis=1)
    areas = [area(t) for t in (below, above, triangles, triangles[flat])]
    assert areas[0] + areas[1] == pytest.approx(areas[2] + areas[3])


def area(triangles):
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@given(plans, st.lists(steps, min_size=7, max_size=7), st.integers(0, 10**6))
@settings(max_examples=30, deadline=None)
def test_no_enclosed_point_is_proven_outside(plan, sizes, seed):
    rng, rays = np.random.default_rng(seed), directions(RAYS)
    (vertices, faces), low, size = blocks(plan, sizes)
    Q = rotation(rng)
    triangles = (vertices @ Q.T)[faces][:, :: rng.choice([-1, 1])]
    triangles = np.concatenate([triangles, triangles[:3] * [1, 1, 0] + 5.0])  # slivers and lines as well
    k = rng.integers(len(low), size=5)
    for point in (low[k] + size[k] * rng.random((5, 3))) @ Q.T:
        assert not proven_outside(point, triangles, rays)
    # On the surface, at corners and on edges, rays start in triangles and run along other triangles.
    for point in [*(vertices[:3] @ Q.T), triangles[0].mean(axis=0), triangles[0, :2].mean(axis=0)]:
        assert not proven_outside(point, triangles, rays)
    assert proven_outside(triangles[:-3].min(axis=(0, 1)) - 0.01, triangles, rays)


def test_a_plane_beside_a_piece_is_refused():
    surface = Surface(np.random.default_rng(0).random((5, 3, 3)))
    with pytest.raises(ValueError, match="does not meet"):
        surface.cut(surface.whole(), 0, 1.5)


def test_a_cavity_counts_as_inside():
    """Check a cavity: every path from the outside into it crosses the surface."""
    outer, faces = meshes.blocks(meshes.BAR, (0, 1), (0, 1), (0, 1))
    both = np.vstack([outer, outer * 0.5 + 0.25])
    mesh = mesh_of(both, np.vstack([faces, faces[:, ::-1] + len(outer)]))
    found = decompose(mesh, replace(PARTS, max_parts=8))
    assert contained(found, np.random.default_rng(0).random((500, 3))).all()


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_a_thinned_hull_contains_all_points_after_thickening(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(300, 3)) * rng.uniform(0.01, 1.0, 3)
    thin, loss = thinned(points, 40)
    assert len(thin.vertices) <= 40
    assert thin.distance(points).max() <= loss + 1e-15
    exact, extent = hull_of(points), np.ptp(points, axis=0).max()
    assert exact.distance(thin.vertices).max() <= JOGGLE * extent
    assert thinned(points, 300)[1] <= 2 * JOGGLE * extent


def test_distances_to_a_hull():
    hull = hull_of(np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float))
    points = np.array(
        [[0.5, 0.5, 0.5], [0.5, 0.5, 3], [2, 2, 0.5], [-1, -1, -1], [1, 1, 1], [0.2, -0.5, 0.9]]
    )
    assert hull.distance(points) == pytest.approx([0, 2, 2**0.5, 3**0.5, 0, 0.5], abs=1e-12)


# --- files --------------------------------------------------------------------------------------------------

ELL_SIZES = (0.1, 0.2, 0.0, 0.2, 0.1, 0.0, 0.1)


def ell():
    return blocks(meshes.ELL, ELL_SIZES)[0]


def test_an_open_surface_is_not_cut_but_has_a_hull():
    vertices, faces = ell()
    mesh = mesh_of(vertices, faces[1:])
    with pytest.raises(ModelError, match=r"not closed: 3 edges .*method: hull"):
        decompose(mesh, PARTS)
    assert contained(decompose(mesh, HULL), vertices).all()


@pytest.mark.parametrize(("suffix", "write"), [("stl", meshes.stl), ("obj", meshes.obj)])
def test_files_are_read_scaled_and_mirrored(tmp_path, suffix, write):
    vertices, faces = ell()
    file = tmp_path / f"ell.{suffix.upper()}"
    file.write_bytes(write(vertices * 1000.0, faces))
    found = convex_parts(file, (-1e-3, 1e-3, 1e-3), PARTS)
    assert len(found) == 2
    corners = np.vstack([np.array(p.shape.vertices) + p.position for p in found])
    assert corners.min(axis=0) == pytest.approx([-vertices[:, 0].max(), 0, 0], abs=1e-5)
    assert corners.max(axis=0) == pytest.approx([0, *vertices[:, 1:].max(axis=0)], abs=1e-5)


BLOCK = meshes.obj(*meshes.blocks(meshes.BAR, (0, 1), (0, 1), (0, 1)))
FLAT = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])


@pytest.mark.parametrize(
    ("name", "data", "text"),
    [
        ("a.stl", b"", "0 bytes; expected a binary STL"),
        ("a.obj", b"", "no triangles"),
        ("a.obj", b"v 0 0\nf 1 2 3\n", "line 1: v with 2 numbers; expected x y z"),
        ("a.obj", b"v nan 0 0\n" + BLOCK, "line 1: 'nan' is not a finite number"),
        ("a.obj", meshes.obj(FLAT, [(0, 1, 2), (1, 2, 3)]), "it is flat"),
        ("a.dae", b"<COLLADA/>", "kind 'dae' are not supported"),
    ],
)  # fmt: skip
def test_unusable_mesh_files_are_refused(tmp_path, name, data, text):
    file = tmp_path / name
    file.write_bytes(data)
    with pytest.raises(ModelError, match=text) as error:
        convex_parts(file, UNIT, PARTS)
    assert str(file) in str(error.value)


def test_packages_are_found_in_the_options_the_path_and_the_parent_folders(tmp_path, monkeypatch):
    package = tmp_path / "src" / "arm_description"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    mesh = package / "meshes" / "a b.stl"
    mesh.write_bytes(meshes.stl(*ell()))
    uri = "package://arm_description/meshes/a%20b.stl"
    assert locate(uri, package / "urdf", {}) == mesh
    assert locate(uri, tmp_path, {"arm_description": package}) == mesh
    with pytest.raises(ModelError, match=r"package 'arm_description' is not known; .*meshes\.packages"):
        locate(uri, Path("/"), {})
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    assert locate(uri, Path("/"), {}) == mesh
    assert locate(mesh.as_uri(), Path("/"), {}) == mesh
    for bad, text in (("http://x/y.stl", "http:// is not supported"), ("none.stl", "there is no file")):
        with pytest.raises(ModelError, match=text):
            locate(bad, tmp_path, {})


URDF = """<robot name="r">
  <link name="base"><collision><geometry><mesh filename="package://arm/ell.stl" scale="0.001 0.001 0.001"/>
  </geometry></collision></link>
  <link name="tool0"><collision name="hand"><origin xyz="1 0 0"/><geometry>
  <mesh filename="{hand}"/></geometry></collision></link>
  <joint name="J" type="revolute"><parent link="base"/><child link="tool0"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="1" effort="0"/></joint>
</robot>"""


def written(tmp_path, hand="ell.obj", **robot):
    vertices, faces = ell()
    folder = tmp_path / "arm"
    folder.mkdir(parents=True)
    (folder / "ell.stl").write_bytes(meshes.stl(1e3 * vertices, faces))
    (folder / "ell.obj").write_bytes(meshes.obj(vertices, faces))
    (folder / "r.urdf").write_text(URDF.format(hand=hand))
    shape = {"mesh": {"file": "arm/ell.stl", "scale": 0.001}}
    cell = {
        "armgate": 1,
        "name": "c",
        "robots": {"A": {"urdf": "arm/r.urdf", "start": [0.0]} | robot},
        "surroundings": {"bracket": {"shape": shape, "xyz": [0, 5, 0]}},
    }
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(cell))
    return path


def test_meshes_of_urdfs_and_surroundings_become_convex_parts(tmp_path):
    cell = build_cell(load_config([written(tmp_path)]))
    names = [b.name for b in cell.bodies]
    assert names == ["A/base/1", "A/base/2", "A/hand/1", "A/hand/2", "bracket/1", "bracket/2"]
    assert {b.shape.kind for b in cell.bodies} == {"convex"}
    assert "<mesh" not in cell.robots[0].urdf
    hull = build_cell(
        load_config([written(tmp_path / "x", meshes={"method": "hull", "bodies": {"hand": {}}})])
    )
    assert [b.name for b in hull.bodies][:3] == ["A/base", "A/hand/1", "A/hand/2"]
    assert hull.hash != cell.hash


def test_a_cell_with_meshes_is_packed_with_all_files(tmp_path):
    """Build the same cell from packed files elsewhere; files of the same name do not collide."""
    path = written(tmp_path / "here")
    other = tmp_path / "here" / "ell.stl"
    vertices, faces = meshes.blocks(meshes.U, (0, 0.1, 0.2, 0.3), (0, 0.1, 0.2), (0.0, 0.1))
    other.write_bytes(meshes.stl(vertices, faces))
    path.write_text(path.read_text() + "  post: {shape: {mesh: {file: ell.stl}}, xyz: [0, -5, 0]}\n")
    config = load_config([path])
    packed = pack(config)
    there = tmp_path / "there"
    there.mkdir()
    (tmp_path / "here").rename(tmp_path / "gone")
    again = build_cell(load_packed(packed, there))
    (tmp_path / "gone").rename(tmp_path / "here")
    cell = build_cell(config)
    assert again.hash == cell.hash
    assert [(b.name, b.shape) for b in again.bodies] == [(b.name, b.shape) for b in cell.bodies]
    assert len([name for name in packed if name.endswith("ell.stl")]) == 2


@pytest.mark.parametrize(
    ("robot", "hand", "text"),
    [
        ({}, "none.stl", r"cell\.yaml:\d+: robots\.A\.urdf: .*link 'tool0', body 'hand': .*there is no file"),
        ({"meshes": {"bodies": {"nothing": {}}}}, "ell.obj", "names 'nothing', but the URDF has no such"),
        ({"meshes": {"method": "best"}}, "ell.obj", r"meshes\.method: .*'parts' or 'hull'"),
        ({"meshes": {"max_parts": 0}}, "ell.obj", r"meshes\.max_parts"),
    ],
)
def test_mesh_errors_give_place_and_remedy(tmp_path, robot, hand, text):
    with pytest.raises(ConfigError, match=text):
        build_cell(load_config([written(tmp_path, hand, **robot)]))

"""Tests of the readers of mesh files: the bodies contain every face, or there is one clear error."""

import re
import struct

import numpy as np
import pytest

from armgate.cell.errors import ModelError
from armgate.cell.mesh.decomposition.decompose import DecompositionOptions, decompose
from armgate.cell.mesh.hull import JOGGLE, hull_of
from armgate.cell.mesh.triangle_mesh import READERS, read_mesh
from cell import mesh_fuzz
from support import meshes
from support.mesh_files import WRITERS

UNIT = (1.0, 1.0, 1.0)
CUBE, TWELVE = meshes.blocks(meshes.BAR, (0, 1), (0, 1), (0, 1))
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def spot(data, suffix):
    mesh = read_mesh(data, suffix, UNIT)
    return len(mesh.faces), mesh.open_edges


def ascii_stl(*solids, end="\n"):
    lines = []
    for name, triangles in solids:
        lines.append(f"solid {name}")
        for triangle in triangles:
            lines += ["facet normal 0 0 0", "outer loop"]
            lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
            lines += ["endloop", "endfacet"]
        lines.append(f"endsolid {name}")
    return end.join(lines).encode("latin-1")


def obj_of(faces, vertices=CUBE, lines=()):
    v = [f"v {x} {y} {z}" for x, y, z in vertices.tolist()]
    return "\n".join([*v, *lines, *("f " + " ".join(str(i + 1) for i in f) for f in faces)]).encode()


def ply_of(faces, body=None, form="ascii", counts=None, index="int"):
    vertices, count = counts or (len(CUBE), len(faces))
    head = f"""ply
format {form} 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {count}
property list uchar {index} vertex_indices
end_header
"""
    rows = [*CUBE.tolist(), *([len(face), *face] for face in faces)]
    text = "".join(" ".join(map(str, row)) + "\n" for row in rows)
    return head.encode() + (text.encode() if body is None else body)


def packed(order, faces):
    rows = [struct.pack(order + "3f", *vertex) for vertex in CUBE]
    return b"".join([*rows, *(struct.pack(f"{order}B{len(f)}i", len(f), *f) for f in faces)])


def off_of(faces, head="OFF", counts=None, tail=""):
    vertices, count = counts or (len(CUBE), len(faces))
    rows = [*CUBE.tolist(), *([len(face), *face] for face in faces)]
    return "\n".join([head, f"{vertices} {count} 0", *(" ".join(map(str, r)) for r in rows), tail]).encode()


TRIANGLES = CUBE[TWELVE]
OBJ = obj_of(TWELVE)
HALVES = ascii_stl(("a", TRIANGLES), ("b", TRIANGLES + np.array([5, 0, 0])))


@pytest.mark.parametrize(
    ("suffix", "data", "faces"),
    [
        ("stl", ascii_stl(("a", TRIANGLES)), 12),
        ("stl", HALVES, 24),
        ("stl", HALVES.upper(), 24),
        ("stl", HALVES.replace(b"\n", b"\r\n").replace(b" ", b"\t  "), 24),
        ("stl", HALVES.replace(b"\n", b"\r"), 24),
        ("stl", ascii_stl(("Gr\xfcn \x85 facet", TRIANGLES)), 12),
        ("stl", b"\xef\xbb\xbf" + HALVES.replace(b"normal 0", b"normal nan"), 24),
        ("stl", HALVES.replace(b"normal 0 0", b"normal -nan(ind) -1.#QNAN"), 24),
        ("stl", b"solid" + meshes.stl(CUBE, TWELVE)[5:], 12),
        ("obj", OBJ.replace(b" ", b"\t"), 12),
        ("obj", OBJ.replace(b"\n", b"\n  "), 12),
        ("obj", OBJ.replace(b"\n", b"\r\n") + b" # no face", 12),
        ("obj", obj_of(QUADS), 12),
        ("obj", obj_of(np.array(QUADS) - 9), 12),
        ("obj", obj_of(TWELVE, lines=["o S\xe4ge", "g f 1 x 3", "s off", "usemtl x", "vn 0 0 1"]), 12),
        ("obj", OBJ + b"\nvn -nan(ind) 1.#QNAN -1.#IND00\nvn nan inf -Infinity\nvt -nan#vt", 12),
        ("obj", re.sub(rb"f (\d+) ", rb"f \\\n \1/1 \\\n", OBJ), 12),
        ("obj", re.sub(rb"(v .*)", rb"\1 0.5 0.5 0.5", OBJ), 12),
        ("obj", b"# C:\\meshes\\\n" + OBJ, 12),
        ("obj", OBJ.replace(b"f 1 ", b"f 1 1 ", 1), 13),
        ("ply", ply_of(TWELVE), 12),
        ("ply", ply_of(QUADS).replace(b"\n", b"\r\n"), 12),
        ("ply", ply_of(QUADS, packed("<", QUADS), "binary_little_endian"), 12),
        ("ply", ply_of(QUADS, packed(">", QUADS), "binary_big_endian"), 12),
        ("ply", ply_of(TWELVE).replace(b"end_header", b"comment Gr\xfcn\nelement camera 0\nend_header"), 12),
        ("off", off_of(QUADS), 12),
        ("off", off_of(TWELVE, tail="# end"), 12),
        ("off", off_of(QUADS).replace(b"OFF\n", b"OFF ").replace(b"\n", b"\r\n"), 12),
    ],
)  # fmt: skip
def test_valid_files_are_read_with_all_faces(suffix, data, faces):
    assert spot(data, suffix)[0] == faces
    bodies = decompose(read_mesh(data, suffix, UNIT), DecompositionOptions("hull", 0.1, 1, 64))
    assert mesh_fuzz.contained(bodies, CUBE).all()


BINARY = meshes.stl(CUBE, TWELVE)
HUGE = BINARY[:80] + struct.pack("<I", 4_000_000_000) + BINARY[84:]
BEYOND = [*TWELVE[:-1].tolist(), (1, 7, 8)]


@pytest.mark.parametrize(
    ("suffix", "data", "text"),
    [
        ("stl", HALVES[:-407], r"line \d+: the file ends in a .*, without 'endsolid': it is truncated"),
        ("stl", HALVES.replace(b"endsolid b", b""), "the file ends in a solid, without 'endsolid'"),
        ("stl", HALVES.replace(b"endfacet\n", b"", 1),
         "line 8: 'facet' in a facet after its loop; expected 'endfacet'"),
        ("stl", HALVES.replace(b"endsolid a\n", b"endsolid a ", 1).replace(b"solid b\n", b"solid b ", 1),
         "a facet is in the line of 'endsolid'; expected one statement in a line"),
        ("stl", HALVES.replace(b"endloop", b"vertex 1 1 1\nendloop", 1), "line 8: a facet with 4 corners"),
        ("stl", HALVES + b"\n0 0", "'0' in the file; expected 'solid'"),
        ("stl", HALVES.replace(b"vertex 0.0", b"vertex nan", 1), "'nan' is not a finite number"),
        ("stl", HALVES.replace(b"vertex 0.0", b"vertex 0,0", 1), "'0,0' is not a finite number"),
        ("stl", HALVES.decode().encode("utf-16"), r"binary STL of \d+ bytes, but its header announces"),
        ("stl", HALVES.replace(b"normal 0", b"normal vertex", 1), "line 2: 'vertex' in a normal; expected"),
        ("stl", BINARY + b"\0\0",
         "announces 12 triangles, which take 684 bytes: 2 bytes follow the last triangle"),
        ("stl", BINARY[:-1], "which take 684 bytes: the file is truncated"),
        ("stl", HUGE, "announces 4000000000 triangles, .* truncated"),
        ("stl", BINARY[:96] + struct.pack("<f", np.inf) + BINARY[100:],
         r"triangle 1 \(byte 84\): .* not a finite number"),
        ("stl", b"solid a\nendsolid a\n", "no triangles"),
        ("obj", b"v 0 0 1.#INF\n" + OBJ, "line 1: '1.#INF' is not a finite number"),
        ("obj", OBJ + b"\nf 1 2", "line 21: a face with 2 corners"),
        ("obj", OBJ + b"\nf 1 2 9", "line 21: vertex 9 does not exist; the file has 8"),
        ("obj", OBJ + b"\nf 1 2 -9", "line 21: vertex -9 does not exist"),
        ("obj", OBJ + b"\nf 1 2 0", "line 21: vertex 0 does not exist"),
        ("obj", OBJ + b"\nf 1 2 3_4", "line 21: '3_4' is not a whole number"),
        ("obj", OBJ + b"\nf 1 2 3 \\", "line 21: the statement is continued beyond the end"),
        ("obj", OBJ + b"\ng C:\\\nf 1 2 3", "line 21: a name that ends in a backslash"),
        ("obj", OBJ + b"\nvn 0 0 1 \\\nf 1 2 3", "line 21: 'vn 0 0 1 f 1 2 3'; expected vn and its numbers"),
        ("obj", OBJ + b"\nvt 0 0 f 1 2 3", "line 21: 'vt 0 0 f 1 2 3'; expected vt and its numbers"),
        ("obj", OBJ + b"\nusemtl steel f 1/1 2//2 3", "line 21: a face is in the line of 'usemtl'"),
        ("obj", OBJ + b"\nF 1 2 3", "line 21: the statement 'F' is not supported"),
        ("obj", OBJ + b"\nl 1 2", "line 21: the statement 'l' is not supported"),
        ("obj", OBJ + b"\nv 0 0 0 2", "line 21: the weight of a vertex is 2"),
        ("obj", OBJ + b"\nv 0 0", "line 21: v with 2 numbers"),
        ("obj", OBJ + b"\nv 0 0 inf", "line 21: 'inf' is not a finite number"),
        ("obj", OBJ + b"\nf 1 2 4 3 8 7 6", "line 21: a face with 7 corners that is not flat"),
        ("obj", OBJ + b"\nf 1 4 2 3", "line 21: a face with 4 corners that is not convex"),
        ("obj", OBJ + b"\nv 0 0.4 0.5\nf 1 2 9 4 3", "line 22: a face with 5 corners that is not convex"),
        ("obj", OBJ + b"\nv 0 0 2e4", "a coordinate of 20000 m; expected at most 1000 m: give another scale"),
        ("obj", b"v 0 0 1e308\n" + OBJ, "expected at most 1000 m"),
        ("obj", OBJ.replace(b"\n", b"\n\0"), "byte 14 is NUL; expected a text file"),
        ("obj", OBJ + b"\nf" + b" 1" * 1025, "line 21: a face with 1025 corners"),
        ("ply", ply_of(BEYOND), "line 29: vertex 8 does not exist; expected 0 to 7"),
        ("ply", ply_of(BEYOND, packed("<", BEYOND), "binary_little_endian"),
         "face 12: vertex 8 does not exist"),
        ("ply", ply_of([*TWELVE.tolist(), (1, 7, -1)]), "line 30: vertex -1 does not exist"),
        ("ply", ply_of([*TWELVE.tolist(), (1, 7)]), "face 13: 2 corners"),
        ("ply", ply_of(TWELVE, counts=(8, 13)), "ends after 12 of 13 rows of the element 'face'"),
        ("ply", ply_of(TWELVE, counts=(8, 11)), "line 29: '3' follows the last row"),
        ("ply", ply_of(TWELVE, counts=(4, 12)), "line 14: .* is not a whole number"),
        ("ply", ply_of(TWELVE, counts=(10**15, 12)), "line 18: '1' follows the last property"),
        ("ply", ply_of(TWELVE, packed("<", TWELVE) + b"\0", "binary_little_endian"),
         "byte 450: 1 bytes follow|follow"),
        ("ply", ply_of(TWELVE, packed("<", TWELVE)[:-1], "binary_little_endian"), "ends after 11 of 12 rows"),
        ("ply", ply_of(TWELVE, b"", "binary_little_endian", counts=(4 * 10**9, 9)),
         "ends after 0 of 4000000000"),
        ("ply", ply_of(TWELVE, form="binary"), "line 2: .*expected 'format KIND 1.0'"),
        ("ply", ply_of(TWELVE, index="float"), "'vertex_indices' is not a list of whole numbers"),
        ("ply", ply_of(TWELVE).replace(b"float z", b"float w"), "0 properties called z; expected one"),
        ("ply", ply_of(TWELVE).replace(b"float z", b"float x"), "line 6: the property 'x' occurs twice"),
        ("ply", ply_of(TWELVE).replace(b"element face", b"element tristrips"),
         "'tristrips' is not supported"),
        ("ply", ply_of(TWELVE).replace(b"end_header", b"end"), "line 9: 'end' in the header"),
        ("ply", ply_of(TWELVE)[:100], "no 'end_header' line: the file is truncated"),
        ("ply", ply_of(TWELVE).replace(b"\n", b"\r\n").replace(b"format ", b"format\n"),
         "line 2: a line end other than that of line 1"),
        ("ply", b"plx\n", "line 1: begins with"),
        ("off", off_of(TWELVE, counts=(8, 13)), "ends after 12 of 13 faces"),
        ("off", off_of(TWELVE, counts=(8, 11)), "line 22: '3' follows the last of 11 faces"),
        ("off", off_of(TWELVE, counts=(7, 13)),
         "line 10: a face of 3 numbers that begins with 1.0|not a whole number"),
        ("off", off_of(TWELVE).replace(b"\n3 ", b"\n3 1.#INF ", 1), "'1.#INF' is no"),
        ("off", off_of(BEYOND), "line 22: vertex 8 does not exist; expected 0 to 7"),
        ("off", off_of(TWELVE, head="OFF BINARY"), r"line 1: 'BINARY'; expected the numbers|line 1"),
        ("off", off_of(TWELVE, head="4OFF"), "line 1: begins with '4OFF'; expected one of COFF, NOFF, OFF"),
        ("off", off_of(TWELVE, counts=(8, -1)), "line 2: a negative number"),
        ("off", b"", "line 1: begins with ''"),
    ],
)  # fmt: skip
def test_damaged_files_are_refused_with_one_clear_error(suffix, data, text):
    with pytest.raises(ModelError, match=text) as error:
        read_mesh(data, suffix, UNIT)
    assert "\n" not in str(error.value)
    assert mesh_fuzz.CLEAR.search(str(error.value))


def test_a_polygon_that_is_not_quite_flat_thickens_the_bodies_by_its_slack():
    """Check that the bodies contain the face with either diagonal."""
    bent = CUBE.copy()
    bent[0] += [0.0005, 0.0, 0.0]
    mesh = read_mesh(obj_of(QUADS, bent), "obj", UNIT)
    assert 0.0 < mesh.slack < 0.01
    bodies = decompose(mesh, DecompositionOptions("parts", 0.1, 4, 64))
    rng = np.random.default_rng(0)
    points = np.vstack([rng.dirichlet(np.ones(4), 200) @ bent[list(quad)] for quad in QUADS])
    assert mesh_fuzz.contained(bodies, points).all()
    assert read_mesh(obj_of(QUADS), "obj", UNIT).slack == 0.0


def test_the_bodies_contain_a_face_without_an_area():
    data = OBJ + b"\nv 2 0 0\nv 3 0 0\nf 9 9 10"
    mesh = read_mesh(data, "obj", UNIT)
    assert (len(mesh.faces), mesh.open_edges) == (13, 0)
    bodies = decompose(mesh, DecompositionOptions("parts", 0.1, 8, 64))
    assert mesh_fuzz.contained(bodies, np.array([[2.0, 0, 0], [2.5, 0, 0], [3, 0, 0]])).all()


def test_hulls_of_points_that_are_coplanar_up_to_rounding():
    """Check sets of points; for some of them, qhull with merged facets crashed the process."""
    for seed in range(400):
        rng = np.random.default_rng(seed)
        Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        corners = np.round(rng.random((12, 3)) * [2, 2, 1]) @ Q.T
        points = corners[rng.integers(len(corners), size=60)]
        points = points + rng.normal(size=points.shape) * 10.0 ** -rng.uniform(8, 17)
        if np.linalg.matrix_rank(corners - corners.mean(axis=0), tol=1e-3) == 3:
            hull = hull_of(points)
            assert hull.height(points).max() <= JOGGLE * 5
            assert set(map(tuple, hull.vertices)) <= set(map(tuple, points))


@pytest.mark.daily(1)
@pytest.mark.parametrize("suffix", WRITERS)
def test_random_files_are_read_completely_or_refused(suffix):
    """Run a short fuzz; ``make fuzz-meshes`` runs a longer one."""
    tally = mesh_fuzz.run(suffix, 160, seed=7)
    assert not tally.faults
    assert tally.ends["valid, read"] == 80
    assert tally.ends["refused"] > 40
    assert set(READERS) == set(WRITERS)

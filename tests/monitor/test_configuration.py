"""The monitor's own readers of configurations, URDFs and mesh files."""

import contextlib
import math
from pathlib import Path

import numpy as np
import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.mesh.formats.obj import read_obj
from armgate.cell.mesh.formats.off import read_off
from armgate.cell.mesh.formats.ply import read_ply
from armgate.cell.mesh.formats.stl import read_stl
from armgate.monitor.config_section import si
from armgate.monitor.errors import DescriptionError
from armgate.monitor.mesh_files import read_mesh
from armgate.monitor.model import build
from armgate.monitor.yaml_files import read_files
from support import meshes
from support.cells import arms_yaml

CONFIGS = Path(__file__).parents[2] / "configs"


def written(folder: Path, text: str, name: str = "cell.yaml") -> Path:
    file = folder / name
    file.write_text(text)
    return file


# --- configurations ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "dimension", "rate", "expected"),
    [
        (1.5, "length", 0, 1.5),
        (2, "angle", 0, 2.0),
        ("50 mm", "length", 0, 0.05),
        ("-94 deg", "angle", 0, -94 * math.pi / 180),
        ("156deg/s", "angle", 1, math.radians(156)),
        ("1.5 m/s2", "length", 2, 1.5),
        ("2e1 rad/s^2", "angle", 2, 20.0),
        ("12 ms", "time", 0, 0.012),
        ("+.5 cm", "length", 0, 0.005),
        ("90 °", "angle", 0, math.pi / 2),
    ],
)
def test_quantities(given, dimension, rate, expected):
    assert si(given, "here", dimension, rate) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "given",
    [
        "",
        "5",
        "5 deg/s",
        "5 mm/s",
        "five mm",
        "5 mm mm",
        True,
        None,
        [1],
        math.nan,
        math.inf,
        "1e999 mm",
        10**400,
    ],
)
def test_an_invalid_length_is_rejected_with_its_place(given):
    with pytest.raises(DescriptionError, match=r"^robots\.FR\.x: .*expected"):
        si(given, "robots.FR.x", "length")


def test_overlays_merge_as_documented(tmp_path):
    (tmp_path / "links").mkdir()
    below = written(
        tmp_path, "armgate: 1\na: {x: 1, y: [1, 2]}\nlink: {kind: emulated, lag: 1}\nurdf: a.urdf\n"
    )
    above = written(tmp_path / "links", "a: {y: [3], z: yes}\nlink: {kind: rsi}\nmesh: {file: b.stl}\n")
    tree = read_files([below, above])
    assert tree["a"] == {"x": 1, "y": [3], "z": "yes"}
    assert tree["link"] == {"kind": "rsi"}
    assert tree["urdf"].path == tmp_path / "a.urdf"
    assert tree["mesh"]["file"].path == tmp_path / "links" / "b.stl"


def test_an_empty_section_of_an_overlay_changes_nothing_and_null_removes(tmp_path):
    below = written(tmp_path, "a: {x: 1}\nb: {y: 2}\nc: {kind: k, v: 1}\nd: 1\n")
    above = written(tmp_path, "a:\nb: null\nc: {kind: , w: 2}\nd:\ne: [~, {f: }]\n", "above.yaml")
    expected = {"a": {"x": 1}, "b": None, "c": {"kind": None, "v": 1, "w": 2}, "d": None}
    assert read_files([below, above]) == {**expected, "e": [None, {"f": None}]}


@pytest.mark.parametrize("section", ["surroundings", "robots", "  A"])
def test_gate_and_monitor_keep_the_mapping_below_an_empty_section(tmp_path, section):
    files = [written(tmp_path, arms_yaml())]
    head = "robots:\n" if section.startswith(" ") else ""
    files.append(written(tmp_path, f"{head}{section}:\n", "above.yaml"))
    mine, theirs = build(read_files(files)), build_cell(load_config(files))
    assert {body.name for body in mine.bodies} == {body.name for body in theirs.bodies}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("armgate: 1", "armgate: 2", "version 2"),
        ("robots:", "robots: [", "not YAML"),
        ("name: arms", "name: arms\nname: x", "'name' occurs twice"),
        ("stop_distance: 20 mm", "stop_distance: 20 s", "stop_distance"),
        ("planar3.urdf", "planar4.urdf", "planar4.urdf"),
        ("cylinder", "blob", "blob"),
        ("xyz: [0.6, 0.9, 0.5]", "xyz: [0.6, 0.9]", "xyz"),
        ("xyz: [0.6", "at: 1, xyz: [0.6", "surroundings.post.at"),
        ("base: {xyz", "base: {rpy: [1, x, 2], xyz", "rpy.1"),
        ("[0.05, 1.0]", "[0.05, -1.0]", "positive"),
    ],
)
def test_unreadable_input_is_rejected_by_name(tmp_path, old, new, said):
    file = written(tmp_path, arms_yaml().replace(old, new, 1))
    with pytest.raises(DescriptionError, match=r"(?s)" + said.replace(".", r"\.")):
        build(read_files([file]))


def test_a_file_that_grows_by_aliases_is_rejected(tmp_path):
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    with pytest.raises(DescriptionError, match="more than"):
        read_files([written(tmp_path, "\n".join(lines))])


def test_unknown_keys_outside_the_geometry_are_noted(tmp_path):
    text = arms_yaml().replace("    period:", "    later: 1\n    period:", 1) + "someday: 2\n"
    notes = build(read_files([written(tmp_path, text)])).notes
    assert len(notes) == 2
    assert any("robots.A.later" in note for note in notes)


# --- URDFs ------------------------------------------------------------------------------------------------


def with_urdf(folder: Path, old: str, new: str):
    text = (CONFIGS / "robots" / "planar3.urdf").read_text()
    assert old in text
    written(folder, text.replace(old, new, 1), "arm.urdf")
    return written(folder, arms_yaml().replace(str(CONFIGS / "robots" / "planar3.urdf"), "arm.urdf"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<robot", "<!DOCTYPE x><robot", "document type"),
        ("<collision>", "<collision><origin yaw='1'/>", "origins|yaw"),
        ('type="revolute"', 'type="continuous"', "continuous"),
        ("</robot>", "", "not a URDF"),
        ("<capsule radius", "<blob radius", "blob"),
        ("<child link=", "<child lonk=", "child"),
        ("<robot name", '<robot version="7" name', "version"),
    ],
)
def test_unsupported_content_of_a_urdf_is_rejected(tmp_path, old, new, said):
    with pytest.raises(DescriptionError, match=said):
        build(read_files([with_urdf(tmp_path, old, new)]))


def test_the_monitor_reads_quaternions_and_accelerations_as_the_cell_does(tmp_path):
    turned = 'quat_xyzw="0.1 0.2 0.3 0.9273618495495703"'
    file = with_urdf(tmp_path, "<collision>", f'<collision><origin xyz="0.1 0 0" {turned}/>')
    urdf = tmp_path / "arm.urdf"
    text = urdf.read_text().replace("<robot ", '<robot version="1.1" ', 1)
    first = text.index("<origin", text.index(turned) + 10)
    end = text.index("/>", first) + 2
    text = text[:first] + text[end:] if text.find("</collision>", text.index(turned)) > first else text
    urdf.write_text(text.replace("velocity=", 'acceleration="3.5" velocity=', 1))
    mine, theirs = build(read_files([file])), build_cell(load_config([file]))
    assert np.allclose(mine.robots[0].acceleration, theirs.robots[0].acceleration)
    assert np.allclose(mine.robots[0].deceleration, theirs.robots[0].deceleration)
    places = {body.name: body.placement for body in mine.bodies}
    for body in theirs.bodies:
        assert np.allclose(places[body.name][:3, :3], body.placement.R)
        assert np.allclose(places[body.name][:3, 3], body.placement.t)


BALL = '<collision name="NAME"><geometry><sphere radius="0.01"/></geometry></collision>'


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<robot", "<!-- no <!DOCTYPE here --><robot"),
        ("<robot", '<robot xmlns="http://example.org/urdf" xmlns:a="b"'),
        ("<collision>", "<collision><drake:proximity_properties/>"),
        ("</robot>", '<drake:collision_filter_group name="x"/></robot>'),
        ("<collision>", '<collision><origin xmlns:a="b" xyz="1 0 0"/>'),
        ("<collision>", f"{BALL}<collision>"),
        ("</collision>", f"</collision>{BALL}"),
    ],
)  # fmt: skip
def test_the_monitor_reads_a_urdf_as_the_gate_does(tmp_path, old, new):
    """Namespaces, comments, and names for nameless collisions."""
    text = (CONFIGS / "robots" / "planar3.urdf").read_text()
    link = text[: text.index("<collision>")].rpartition('<link name="')[2].partition('"')[0]
    if "<origin" in new:
        own = text[text.index("<collision>") :].partition("</collision>")[0]
        text = text.replace(
            own, own[: own.index("<origin")] + own[own.index("/>", own.index("<origin")) + 2 :]
        )
    urdf = written(tmp_path, text.replace(old, new.replace("NAME", link), 1), "arm.urdf")
    file = written(tmp_path, arms_yaml("A").replace(str(CONFIGS / "robots" / "planar3.urdf"), urdf.name))
    mine, theirs = build(read_files([file])), build_cell(load_config([file]))
    assert sorted(body.name for body in mine.bodies) == sorted(body.name for body in theirs.bodies)
    places = {body.name: body.placement for body in mine.bodies}
    assert all(np.allclose(places[body.name][:3, 3], body.placement.t) for body in theirs.bodies)


# --- meshes -----------------------------------------------------------------------------------------------


BLOCK = meshes.blocks(meshes.BAR, (0.0, 0.2), (0.0, 0.3), (0.0, 0.4))


def text_stl(vertices, faces) -> bytes:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in vertices[face])
        + "endloop\nendfacet\n"
        for face in faces
    )  # fmt: skip
    return f"solid a b\n{facets}endsolid a b\n".encode()


def off(vertices, faces) -> bytes:
    rows = [" ".join(map(str, v)) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    return "\n".join([f"OFF\n{len(vertices)} {len(faces)} 0", *rows]).encode()


def ply(vertices, faces, form="ascii") -> bytes:
    head = (
        f"ply\nformat {form} 1.0\ncomment x\nelement vertex {len(vertices)}\n"
        f"property double x\nproperty double y\nproperty double z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = [" ".join(map(str, v)) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
        return head + "\n".join(rows).encode() + b"\n"
    order = "<" if "little" in form else ">"
    body = np.asarray(vertices, dtype=f"{order}f8").tobytes()
    return head + body + b"".join(b"\x03" + np.asarray(f, dtype=f"{order}i4").tobytes() for f in faces)


FILES = {
    "a.stl": meshes.stl(*BLOCK),
    "b.stl": text_stl(*BLOCK),
    "c.obj": meshes.obj(*BLOCK),
    "d.off": off(*BLOCK),
    "e.ply": ply(*BLOCK),
    "f.ply": ply(*BLOCK, "binary_little_endian"),
    "g.ply": ply(*BLOCK, "binary_big_endian"),
}


@pytest.mark.parametrize("name", FILES)
def test_each_format_gives_all_vertices_and_triangles(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    mesh = read_mesh(tmp_path / name)
    assert np.allclose(np.unique(mesh.vertices, axis=0), np.unique(BLOCK[0], axis=0), atol=1e-7)
    assert len(mesh.triangles) == len(BLOCK[1])
    corners = {tuple(sorted(map(tuple, np.round(t, 6).tolist()))) for t in mesh.vertices[mesh.triangles]}
    expected = {tuple(sorted(map(tuple, np.round(t, 6).tolist()))) for t in BLOCK[0][BLOCK[1]]}
    assert corners == expected


def test_relative_indices_and_polygons_of_an_obj_are_read(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n f -4/1 -3//2 -2/3/4 -1\n\to x\nv 0 0 1\n\tf 1 2 5\n"
    mesh = read_mesh(written(tmp_path, text, "m.obj"))
    assert len(mesh.triangles) == 3
    assert len(mesh.vertices) == 5


_GATE = {".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off}
BOM = b"\xef\xbb\xbf"
OBJ, OFF, PLY, STL = FILES["c.obj"], FILES["d.off"], FILES["e.ply"], FILES["b.stl"]
VARIANTS = {
    "bom.stl": BOM + STL,
    "vertex.stl": STL.replace(b"solid a b", b"solid vertex cover"),
    "latin.stl": STL.replace(b"solid a b", b"solid H\xf6he"),
    "bom.obj": BOM + OBJ,
    "latin.obj": b"# H\xf6he\no T\xfcr\n" + OBJ,
    "nel.obj": "# Å v 1 2 3\n".encode() + OBJ,
    "fo.obj": OBJ.replace(b"\nf ", b"\nfo "),
    "continued.obj": OBJ.replace(b"\nf ", b"\nf \\\r\n"),
    "utf.ply": PLY.replace(b"comment x", "comment ü".encode()),
    "latin.ply": PLY.replace(b"comment x", b"comment \xfc"),
    "lower.off": OFF.replace(b"OFF", b"off"),
    "coloured.off": off(np.hstack([BLOCK[0], np.ones((len(BLOCK[0]), 4))]), BLOCK[1]).replace(
        b"OFF", b"COFF"
    ),
    "normals.off": off(np.hstack([BLOCK[0], np.ones((len(BLOCK[0]), 3))]), BLOCK[1]).replace(b"OFF", b"NOFF"),
    "latin.off": OFF.replace(b"OFF\n", b"OFF # \xfc\n"),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_variants_that_the_gate_reads_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(VARIANTS[name])
    assert VARIANTS[name] not in (OBJ, OFF, PLY, STL)
    mesh = read_mesh(tmp_path / name)
    assert np.allclose(np.unique(mesh.vertices, axis=0), np.unique(BLOCK[0], axis=0), atol=1e-7)
    assert len(mesh.triangles) == len(BLOCK[1])
    _GATE[Path(name).suffix](VARIANTS[name])


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_mesh_is_rejected_or_read_completely(tmp_path, name):
    """A truncated file or a changed byte gives one clear error, never another exception."""
    rng = np.random.default_rng(6)
    data = FILES[name]
    for _ in range(60):
        cut = int(rng.integers(0, len(data)))
        changed = bytearray(data)
        changed[cut] = int(rng.integers(0, 256))
        for damaged in (data[:cut], bytes(changed)):
            (tmp_path / name).write_bytes(damaged)
            with contextlib.suppress(DescriptionError):
                assert len(read_mesh(tmp_path / name).triangles) > 0


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("x.dae", b"<COLLADA/>", "expected one of"),
        ("x.obj", b"v 0 0 0\nf 1 2 3\n", "does not exist"),
        ("x.off", b"NOFF 1", "OFF"),
        ("x.ply", b"ply\nformat ascii 2.0\nelement vertex nope\nend_header\n", "damaged"),
        ("x.stl", b"solid x\nfacet\nvertex 0 0 0\n", "an incomplete text STL"),
    ],
)
def test_an_unreadable_mesh_is_rejected_with_its_name(tmp_path, name, data, said):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(DescriptionError, match=said):
        read_mesh(tmp_path / name)

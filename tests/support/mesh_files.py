"""Random mesh files, valid and damaged, with their faces.

A face is an array (k, 3) of its corners. ``solid`` makes closed surfaces, ``WRITERS`` write them in the
forms of various programs, ``damaged`` breaks a file, and ``FACES`` read the faces independently of the
product.
"""

import re
import struct

import numpy as np

from support import meshes

NAMES = [b"part", b"Schwei\xdfbrenner \xfc", b"a b c", b"facet_1", b"solid", b"", b"endsolid x", b"v 1 2 3"]


# --- surfaces -----------------------------------------------------------------------------------------------


def solid(rng, polygons=True):
    """Return one or two closed surfaces, each as (vertices, faces as tuples of indices)."""
    return [_placed(rng, *_surface(rng, polygons)) for _ in range(int(rng.integers(1, 3)))]


def _surface(rng, polygons):
    kind = rng.choice(["prism", "pyramid", "blocks", "ring"], p=[0.5, 0.2, 0.2, 0.1])
    if kind == "blocks":
        plan = [meshes.ELL, meshes.U, meshes.CROSS, meshes.BAR][int(rng.integers(4))]
        steps = np.cumsum(rng.uniform(0.05, 0.3, 8))
        return meshes.blocks(plan, steps[:4], steps[3 : 3 + len(plan) + 1], steps[:2])
    if kind == "ring":
        return meshes.ring(0.1, 0.2, 0.1, int(rng.integers(3, 5)))
    sides = int(rng.integers(3, 9))
    found = _prism(rng, sides, kind == "pyramid")
    return found if polygons else _triangles(*found)


def _prism(rng, sides, pyramid):
    angles = np.sort(rng.uniform(0, 0.9 * 2 * np.pi / sides, sides) + np.arange(sides) * 2 * np.pi / sides)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(sides)]) * rng.uniform(0.05, 0.3)
    low, around = tuple(range(sides))[::-1], [(i, (i + 1) % sides) for i in range(sides)]
    if pyramid:
        return np.vstack([rim, [[0, 0, rng.uniform(0.1, 0.5)]]]), [low, *((i, j, sides) for i, j in around)]
    high = tuple(range(sides, 2 * sides))
    walls = [(i, j, sides + j, sides + i) for i, j in around]
    return np.vstack([rim, rim + np.array([0, 0, rng.uniform(0.05, 0.5)])]), [low, high, *walls]


def _triangles(vertices, faces):
    return vertices, [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]


def _placed(rng, vertices, faces):
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved = vertices @ Q.T if rng.random() < 0.7 else vertices
    return moved + rng.uniform(-1, 1, 3), [tuple(int(i) for i in face) for face in faces]


# --- writers ------------------------------------------------------------------------------------------------


def text(rng, lines):
    """Return lines of words as a text file with any line ends, blank lines, spaces and tabs."""
    end = [b"\n", b"\r\n", b"\r"][int(rng.integers(3))]
    gap, indent = [b" ", b"\t", b"  "][int(rng.integers(3))], [b"", b"  ", b"\t"][int(rng.integers(3))]
    out = [indent + gap.join(line) if isinstance(line, list) else line for line in lines]
    for _ in range(int(rng.integers(3))):
        at = int(rng.integers(1, len(out) + 1))
        if not out[at - 1].endswith(b"\\"):
            out.insert(at, b"")
    return end.join(out) + (end if rng.random() < 0.7 else b"")


def number(rng, value):
    return [b"%r" % float(value), b"%.6f" % value, b"%.7e" % value][int(rng.integers(3))]


def stl_ascii(rng):
    case = [bytes.lower, bytes.upper, lambda word: word][int(rng.integers(3))]
    lines = []
    for vertices, faces in solid(rng, polygons=False):
        name = NAMES[int(rng.integers(len(NAMES)))]
        lines.append([case(b"solid"), name])
        for face in faces:
            normal = [b"0", b"0", b"nan"] if rng.random() < 0.1 else [b"0", b"0", b"1"]
            lines += [[case(b"facet"), case(b"normal"), *normal], [case(b"outer"), case(b"loop")]]
            lines += [[case(b"vertex"), *(number(rng, x) for x in vertices[i])] for i in face]
            lines += [[case(b"endloop")], [case(b"endfacet")]]
        lines.append([case(b"endsolid"), name])
    return text(rng, lines)


def stl_binary(rng):
    parts = solid(rng, polygons=False)
    data = b"".join(meshes.stl(vertices, np.array(faces))[84:] for vertices, faces in parts)
    head = [b"solid made by a program", b"", b"\xfcber"][int(rng.integers(3))].ljust(80, b"\0")
    return head + struct.pack("<I", len(data) // 50) + data


def obj(rng):
    lines, known = [[b"mtllib", b"a.mtl"]], 0
    if rng.random() < 0.3:
        lines.insert(0, b"# made by hand; f 1 2 3 is no face here \\")
    for vertices, faces in solid(rng):
        lines.append([[b"o", b"g"][int(rng.integers(2))], NAMES[int(rng.integers(len(NAMES)))]])
        colour = [b"0.5"] * 3 if rng.random() < 0.2 else []
        lines += [[b"v", *(number(rng, x) for x in vertex), *colour] for vertex in vertices]
        lines += [[b"vn", b"0", b"0", b"1"], [b"vt", b"0.5", b"0.5"], [b"usemtl", b"steel"], [b"s", b"off"]]
        relative, suffix = rng.random() < 0.4, [b"", b"/1", b"/1/1", b"//1"][int(rng.integers(4))]
        for face in faces:
            indices = [i - len(vertices) if relative else known + i + 1 for i in face]
            words = [b"f", *(b"%d" % i + suffix for i in indices)]
            if rng.random() < 0.1:
                lines += [[*words[:2], b"\\"], words[2:]]
            else:
                lines.append([*words, b"# a face"] if rng.random() < 0.1 else words)
        known += len(vertices)
    return text(rng, lines)


def off(rng):
    vertices, faces = joined(solid(rng))
    head = [b"%d" % count for count in (len(vertices), len(faces), 0)]
    colour = [b"255", b"0", b"0", b"255"] if rng.random() < 0.3 else []
    kind = b"COFF" if colour else b"OFF"
    lines = [[kind, *head]] if rng.random() < 0.3 else [[kind], head]
    lines.insert(1, b"# comment")
    lines += [[*(number(rng, x) for x in vertex), *colour] for vertex in vertices]
    paint = [[], [b"7"], [b"0.5", b"0.5", b"0.5"]][int(rng.integers(3))]
    return text(rng, [*lines, *([b"%d" % len(face), *(b"%d" % i for i in face), *paint] for face in faces)])


def ply(rng):
    vertices, faces = joined(solid(rng))
    kind = ["ascii", "binary_little_endian", "binary_big_endian"][int(rng.integers(3))]
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    real = [("float", "f"), ("double", "d"), ("float32", "f")][int(rng.integers(3))]
    index = [("int", "i"), ("uint", "I"), ("ushort", "H")][int(rng.integers(3))]
    size = [("uchar", "B"), ("int", "i")][int(rng.integers(2))]
    extra, painted = rng.random() < 0.5, rng.random() < 0.3
    head = ["ply", f"format {kind} 1.0", "comment gr\xfcn", "obj_info 3", f"element vertex {len(vertices)}"]
    head += [f"property uchar {name}" for name in ("red", "green", "blue") if extra]
    head += [f"property {real[0]} {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}"]
    head += [f"property list {size[0]} {index[0]} {['vertex_indices', 'vertex_index'][int(rng.integers(2))]}"]
    head += ["property list uchar float texcoord"] * painted + ["end_header"]
    columns = ["3B"] * extra + [f"3{real[1]}"]
    end = [b"\n", b"\r\n"][int(rng.integers(2))]
    rows = [[*[9] * 3 * extra, *map(float, vertex)] for vertex in vertices]
    faces = [[len(face), *face, *([2, 0.5, 0.5] if painted else [])] for face in faces]
    start = end.join(line.encode("latin-1") for line in head) + end
    if kind == "ascii":
        return start + text(rng, [[b"%r" % value for value in row] for row in (*rows, *faces)])
    body = [struct.pack(order + "".join(columns), *row) for row in rows]
    for row in faces:
        k = row[0]
        body.append(struct.pack(f"{order}{size[1]}{k}{index[1]}" + "B2f" * painted, *row))
    return start + b"".join(body)


def joined(parts):
    vertices, faces, known = [], [], 0
    for some, own in parts:
        vertices.append(some)
        faces += [tuple(known + i for i in face) for face in own]
        known += len(some)
    return np.vstack(vertices), faces


WRITERS = {
    "stl": lambda rng: (stl_ascii if rng.random() < 0.5 else stl_binary)(rng),
    "obj": obj,
    "ply": ply,
    "off": off,
}

# --- damage -------------------------------------------------------------------------------------------------

TOKENS = [b"nan", b"-inf", b"1e999", b"-1", b"0", b"99999", b"4294967295", b"1_0", b"0x10", b"1,5", b"abc",
          b"1e9", b"f", b"\\", b"#", b"vertex", b"99999999999999999999", b"-9"]  # fmt: skip


def damaged(rng, data):
    """Return a file with one to three faults of any kind."""
    for _ in range(int(rng.integers(1, 4))):
        data = _DAMAGES[int(rng.integers(len(_DAMAGES)))](rng, data)
    return data


def _cut(rng, data):
    return data[: int(rng.integers(len(data) + 1))]


def _tail(rng, data):
    return data + [b"\0", b"\0\0", b" ", b"\n", b"0 0 0\n", b"f 1 2 3", bytes(50)][int(rng.integers(7))]


def _byte(rng, data):
    at = int(rng.integers(len(data) + 1))
    new = [b"", bytes([int(rng.integers(256))]), b"\r", b"\x85", b"\\", b"#", b"\0"][int(rng.integers(7))]
    return data[:at] + new + data[at + int(rng.integers(2)) :]


def _line(rng, data):
    lines = data.split(b"\n")
    i, j = (int(k) for k in rng.integers(len(lines), size=2))
    what = int(rng.integers(4))
    if what == 0:
        del lines[i]
    elif what == 1:
        lines.insert(i, lines[j])
    elif what == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i : i + 2] = [b" ".join(lines[i : i + 2])]
    return b"\n".join(lines)


def _token(rng, data):
    tokens = list(re.finditer(rb"\S+", data[:4000] if rng.random() < 0.5 else data))
    if not tokens:
        return data
    found = tokens[int(rng.integers(len(tokens)))]
    return data[: found.start()] + TOKENS[int(rng.integers(len(TOKENS)))] + data[found.end() :]


def _count(rng, data):
    """Replace one whole number, which may be a count of the header or an index."""
    tokens = list(re.finditer(rb"(?<![.\d])\d+(?![.\d])", data[: 600 if rng.random() < 0.5 else len(data)]))
    if not tokens:
        return data
    found = tokens[int(rng.integers(len(tokens)))]
    value = int(found[0]) + int(rng.choice([-1, 1, 1000, 10**9]))
    return data[: found.start()] + b"%d" % value + data[found.end() :]


_DAMAGES = [_cut, _tail, _byte, _line, _token, _count]

# --- faces, read by other means -----------------------------------------------------------------------------


def stl_faces(data):
    """Return the faces of an STL file: every three vertices of a text, or all records after the header."""
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= 84 else -1
    if len(data) == 84 + 50 * count:
        return [
            np.array(struct.unpack_from("<9f", data, 84 + 50 * k + 12)).reshape(3, 3) for k in range(count)
        ]
    words = re.sub(r"(?m)(?<![^\r\n])[ \t]*(end)?solid[^\r\n]*", "", data.decode("latin-1").lower())
    found = re.findall(r"(?<!\S)vertex\s+(\S+)\s+(\S+)\s+(\S+)", words)
    assert len(re.findall(r"(?<!\S)facet\s+normal(?!\S)", words)) * 3 == len(found)
    return list(np.array(found, dtype=float).reshape(-1, 3, 3))


def obj_faces(data):
    plain = re.sub(r"#[^\r\n]*", "", data.decode("latin-1").removeprefix("\xef\xbb\xbf"))
    plain = re.sub(r"\\(\r\n|\n|\r)", " ", plain)
    vertices, faces = [], []
    for line in re.split(r"[\r\n]+", plain):
        key, *rest = line.split(maxsplit=1) or [""]
        if key == "v":
            vertices.append([float(x) for x in rest[0].split()[:3]])
        elif key in ("f", "fo"):
            given = [int(word.partition("/")[0]) for word in rest[0].split()]
            faces.append([i - 1 if i > 0 else len(vertices) + i for i in given])
    return [np.array([vertices[i] for i in face]) for face in faces]


def off_faces(data):
    plain = re.sub(r"#[^\r\n]*", "", data.decode("latin-1").removeprefix("\xef\xbb\xbf"))
    words = re.match(r"\s*(\w*OFF)\s+(\d+)\s+(\d+)\s+\S+\s+", plain, re.IGNORECASE)
    rows = [row.split() for row in re.split(r"[\r\n]+", plain[words.end() :]) if row.split()]
    count = int(words[2])
    vertices = [[float(x) for x in row[:3]] for row in rows[:count]]
    return [np.array([vertices[int(i)] for i in row[1 : 1 + int(row[0])]]) for row in rows[count:]]


def ply_faces(data):
    head = re.match(rb"ply\s.*?[\r\n][ \t]*end_header[ \t]*(\r\n|\r|\n)", data, re.DOTALL)
    lines = [line.split() for line in re.split(rb"[\r\n]+", head[0])]
    kind = next(line[1] for line in lines if line[:1] == [b"format"])
    elements = []
    for line in lines:
        if line[:1] == [b"element"]:
            elements.append((line[1], int(line[2]), []))
        elif line[:1] == [b"property"]:
            elements[-1][2].append(line[1:])
    if kind == b"ascii":
        words = iter(data[head.end() :].split())

        def take(kind, count):
            return [float(next(words)) for _ in range(count)]

    else:
        at, order = [head.end()], ">" if b"big" in kind else "<"

        def take(kind, count):
            form = f"{order}{count}{_C[kind.decode()]}"
            at[0] += struct.calcsize(form)
            return struct.unpack_from(form, data, at[0] - struct.calcsize(form))

    rows = {name: [_ply_row(columns, take) for _ in range(count)] for name, count, columns in elements}
    vertices = [[row[axis][0] for axis in (b"x", b"y", b"z")] for row in rows[b"vertex"]]
    faces = [
        next(row[key] for key in (b"vertex_indices", b"vertex_index") if key in row) for row in rows[b"face"]
    ]
    return [np.array([vertices[int(i)] for i in face]) for face in faces]


_C = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f",
      "double": "d", "float32": "f"}  # fmt: skip


def _ply_row(columns, take):
    row = {}
    for column in columns:
        count = int(take(column[1], 1)[0]) if column[0] == b"list" else 1
        row[column[-1]] = take(column[-2], count)
    return row


FACES = {"stl": stl_faces, "obj": obj_faces, "ply": ply_faces, "off": off_faces}

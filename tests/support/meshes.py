"""Meshes for tests: blocks on a grid of uneven steps, round rings, and their files."""

import struct
from itertools import product

import numpy as np

ELL = ("##", "#.")
U = ("#.#", "###")
FRAME = ("###", "#.#", "###")
CROSS = (".#.", "###", ".#.")
BAR = ("#",)


def blocks(plan, xs, ys, height):
    """Return (vertices, faces) of a prism over the cells '#' of a plan.

    The cell (row, column) spans ys and xs at these indices.
    """
    filled = {(i, j) for i, row in enumerate(plan) for j, mark in enumerate(row) if mark == "#"}
    cells = {(i, j, k) for (i, j), k in product(filled, range(len(height) - 1))}
    steps = (ys, xs, height)
    faces = []
    for cell, axis, side in product(cells, range(3), (0, 1)):
        beside = tuple(c + (2 * side - 1) * (a == axis) for a, c in enumerate(cell))
        if beside not in cells:
            u, v = (axis + 1) % 3, (axis + 2) % 3
            corners = []
            for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                corner = list(cell)
                corner[axis] += side
                corner[u] += du
                corner[v] += dv
                corners.append(tuple(steps[a][c] for a, c in enumerate(corner)))
            a, b, c, d = corners if side else corners[::-1]
            faces += [(a, b, c), (a, c, d)]
    # Corners are (y, x, z). Exchanging y and x is a reflection, so the order of the corners is reversed.
    triangles = np.array(faces, dtype=float)[:, ::-1][:, :, [1, 0, 2]]
    vertices, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 3)


def ring(inner, outer, height, count=16):
    """Return (vertices, faces) of a round ring."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.vstack([np.column_stack([r * circle, np.full(count, z)])
                          for z in (0.0, height) for r in (inner, outer)])  # fmt: skip

    def at(z, r, i):
        return (2 * z + r) * count + i % count

    quads = []
    for i in range(count):
        quads += [
            (at(0, 1, i), at(0, 1, i + 1), at(1, 1, i + 1), at(1, 1, i)),
            (at(0, 0, i + 1), at(0, 0, i), at(1, 0, i), at(1, 0, i + 1)),
            (at(1, 1, i), at(1, 1, i + 1), at(1, 0, i + 1), at(1, 0, i)),
            (at(0, 0, i), at(0, 0, i + 1), at(0, 1, i + 1), at(0, 1, i)),
        ]
    return vertices, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def volume(vertices, faces):
    """Return the volume that a closed surface encloses, positive if it is wound outward."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6)


def stl(vertices, faces):
    """Return a binary STL file."""
    records = [struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel(), 0) for face in faces]
    return b"\0" * 80 + struct.pack("<I", len(records)) + b"".join(records)


def obj(vertices, faces):
    """Return a Wavefront OBJ file."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices).tolist()]
    return "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces)]).encode() + b"\n"

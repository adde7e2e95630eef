"""Meshes of primitive shapes: triangles and edges, in m, with outward normals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armgate.cell.placement import Placement

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

ROUND = 40
"""Number of corners of a circle."""
CAP = 10
"""Number of rings from the rim of a cap to its pole."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Surface of triangles.

    Attributes:
        vertices: Vertices (k, 3), m.
        normals: Surface normals at the vertices, (k, 3).
        faces: Vertex indices, counter-clockwise seen from outside, (t, 3).
        edges: Ends of the lines that mark its edges, (e, 2, 3), m; empty for a smooth surface.
    """

    vertices: Array
    normals: Array
    faces: Faces
    edges: Array

    def at(self, place: Placement) -> "Mesh":
        """Return the mesh at another pose."""
        return Mesh(place.apply(self.vertices), self.normals @ place.R.T, self.faces, place.apply(self.edges))


def joined(meshes: list[Mesh]) -> Mesh:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]),
        np.concatenate([mesh.edges for mesh in meshes]),
    )


def mesh_of(kind: str, size: tuple[float, ...]) -> Mesh:
    """Return the surface of a primitive of this kind and size, as in the protocol (and ``cone``)."""
    match kind:
        case "box":
            return box(*size)
        case "sphere":
            return _turned(_arc(size[0], 0.0))
        case "capsule":
            return _turned(_arc(size[0], size[1]))
        case "cylinder":
            return cylinder(*size)
        case "cone":
            return _sharp([(size[0], -size[1] / 2), (0.0, size[1] / 2)])
        case _:
            raise ValueError(f"unknown shape {kind!r}")


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box with these full edge lengths."""
    axes = np.eye(3)
    half = np.array([x, y, z]) / 2
    corners: list[Array] = []
    normals: list[Array] = []
    faces: list[tuple[int, int, int]] = []
    edges: list[list[Array]] = []
    for axis in range(3):
        u, v = axes[(axis + 1) % 3], axes[(axis + 2) % 3]
        for side in (1.0, -1.0):
            ring = [axes[axis] * side + a * u + side * b * v for a, b in _SQUARE]
            start = len(corners)
            corners += ring
            normals += [axes[axis] * side] * 4
            faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
    for axis in range(3):
        u, v = axes[(axis + 1) % 3], axes[(axis + 2) % 3]
        edges += [[axes[axis] + a * u + b * v, -axes[axis] + a * u + b * v] for a, b in _SQUARE]
    return Mesh(np.array(corners) * half, np.array(normals), np.array(faces), np.array(edges) * half)


_SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


def cylinder(radius: float, length: float) -> Mesh:
    """Return a flat-ended cylinder around z."""
    return _sharp([(radius, -length / 2), (radius, length / 2)])


def convex(vertices: Array, faces: Faces) -> Mesh:
    """Return a convex hull with flat faces: own corners per triangle, edges where faces meet at an angle."""
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    own = np.arange(3 * len(faces)).reshape(-1, 3)
    return Mesh(
        corners.reshape(-1, 3), np.repeat(normals, 3, axis=0), own, _creases(vertices, faces, normals)
    )


def _creases(vertices: Array, faces: Faces, normals: Array) -> Array:
    seen: dict[tuple[int, int], int] = {}
    found = []
    for face, corners in enumerate(faces.tolist()):
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            other = seen.pop((min(a, b), max(a, b)), None)
            if other is None:
                seen[min(a, b), max(a, b)] = face
            elif normals[face] @ normals[other] < np.cos(np.radians(30)):
                found.append((a, b))
    return vertices[np.array(found, dtype=np.int64).reshape(-1, 2)]


def _arc(radius: float, length: float) -> tuple[Array, Array, Array]:
    """Return a capsule's outline from pole to pole: distance from the axis, height, angle of the normal."""
    low = np.linspace(-np.pi / 2, 0.0, CAP + 1)
    angle = np.concatenate([low, -low[::-1]])
    height = radius * np.sin(angle) + np.repeat([-length / 2, length / 2], CAP + 1)
    return radius * np.cos(angle), height, angle


def _turned(outline: tuple[Array, Array, Array]) -> Mesh:
    """Return a smooth surface of revolution around z."""
    radius, height, angle = outline
    u = np.linspace(0.0, 2 * np.pi, ROUND, endpoint=False)
    around = np.stack([np.cos(u), np.sin(u)])
    ring = np.ones(ROUND)
    points = [
        np.stack([r * around[0], r * around[1], h * ring], axis=1)
        for r, h in zip(radius, height, strict=True)
    ]
    normals = [
        np.stack([np.cos(a) * around[0], np.cos(a) * around[1], np.sin(a) * ring], axis=1) for a in angle
    ]
    return Mesh(np.concatenate(points), np.concatenate(normals), _bands(len(radius)), np.zeros((0, 2, 3)))


def _sharp(outline: list[tuple[float, float]]) -> Mesh:
    """Return a surface of revolution with flat ends and sharp rims, from two points (radius, height)."""
    (low, bottom), (high, top) = outline
    slope = np.arctan2(low - high, top - bottom)
    side = (np.array([low, high]), np.array([bottom, top]), np.array([slope, slope]))
    down = (np.array([0.0, low]), np.array([bottom, bottom]), np.array([-np.pi / 2] * 2))
    up = (np.array([high, 0.0]), np.array([top, top]), np.array([np.pi / 2] * 2))
    mesh = joined([_turned(part) for part in (down, side, up)])
    rims = [_rim(radius, height) for radius, height in outline if radius > 0.0]
    return Mesh(mesh.vertices, mesh.normals, mesh.faces, np.concatenate(rims))


def _rim(radius: float, height: float) -> Array:
    u = np.linspace(0.0, 2 * np.pi, ROUND + 1)
    ring = np.stack([radius * np.cos(u), radius * np.sin(u), np.full(ROUND + 1, height)], axis=1)
    return np.stack([ring[:-1], ring[1:]], axis=1)


def _bands(rings: int) -> Faces:
    faces = []
    for ring in range(rings - 1):
        for k in range(ROUND):
            a, b = ring * ROUND + k, ring * ROUND + (k + 1) % ROUND
            faces += [(a, b, b + ROUND), (a, b + ROUND, a + ROUND)]
    return np.array(faces)

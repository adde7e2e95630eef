"""Random mesh files, valid and damaged: each is refused with one clear error, or its bodies have all faces.

``make fuzz-meshes RUNS=10000`` tries this number of files of each format. Faces are counted and placed
independently of the product's readers (``support.mesh_files``). Nine of ten meshes are cut at random planes,
which is faster than the product's own choice and must not affect containment.
"""

import os
import re
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

from armgate.cell.errors import ModelError
from armgate.cell.mesh.decomposition.choose_planes import Plane
from armgate.cell.mesh.decomposition.decompose import DecompositionOptions, decompose
from armgate.cell.mesh.hull import hull_of
from armgate.cell.mesh.triangle_mesh import READERS, read_mesh
from support.mesh_files import FACES, WRITERS, damaged

PARTS = DecompositionOptions("parts", 0.5, 3, 64)
HULL = DecompositionOptions("hull", 0.5, 1, 64)
_SAMPLES = 3
CLEAR = re.compile(r"expected|export it again|export the file again|method: hull")


@dataclass
class Tally:
    """Results for the files of one format."""

    ends: Counter = field(default_factory=Counter)
    faces: int = 0
    faults: list = field(default_factory=list)


def contained(bodies, points):
    """Return True for each point that lies in a body: inside all planes of its hull, moved by its radius."""
    inside = np.zeros(len(points), dtype=bool)
    for body in bodies:
        corners = np.array(body.vertices)
        normals = hull_of(corners).normals
        inside |= np.all(points @ normals.T <= (corners @ normals.T).max(axis=0) + body.radius, axis=1)
    return inside


def bodies_of(mesh, rng):
    """Return the convex parts, or the hull if the surface is open: the error recommends that method."""
    try:
        if rng.random() < 0.1:
            return decompose(mesh, PARTS)
        with patch(
            "armgate.cell.mesh.decomposition.decompose.propose_planes", lambda *_: _anywhere(mesh, rng)
        ):
            return decompose(mesh, PARTS)
    except ModelError as error:
        if "not closed" not in str(error):
            raise
        return decompose(mesh, HULL)


def _anywhere(mesh, rng):
    """Return one or two random cuts of the whole mesh, all across one axis."""
    axis = int(rng.integers(3))
    low, high = mesh.vertices[:, axis].min(), mesh.vertices[:, axis].max()
    places = np.sort(rng.uniform(low, high, int(rng.integers(1, 3))))
    return [Plane(number, axis, float(at)) for number, at in enumerate(places)]


def check(data, suffix, rng):
    """Check that the bodies contain all faces; return their number, or None if the file is refused."""
    try:
        mesh = read_mesh(data, suffix, (1.0, 1.0, 1.0))
    except ModelError as error:
        text = str(error)
        assert CLEAR.search(text), text
        assert "\n" not in text, text
        assert len(text) < 400, text
        return None
    faces = FACES[suffix](data)
    assert len(READERS[suffix](data).sizes) == len(faces)
    assert len(mesh.faces) == sum(len(face) - 2 for face in faces)
    points = np.vstack([np.vstack([face, _inside(face, rng)]) for face in faces])
    inside = contained(bodies_of(mesh, rng), points)
    assert inside.all(), f"{np.count_nonzero(~inside)} points of faces are in no body"
    return len(faces)


def _inside(face, rng):
    return rng.dirichlet(np.full(len(face), 0.5), _SAMPLES) @ face


def run(suffix, runs, seed):
    """Try files of one format, half of them damaged."""
    tally = Tally()
    for number in range(runs):
        rng = np.random.default_rng([seed, number])
        data = WRITERS[suffix](rng)
        broken = number % 2 == 1
        if broken:
            data = damaged(rng, data)
        try:
            faces = check(data, suffix, rng)
            assert broken or faces is not None, "a valid file is refused"
        except Exception as error:  # a traceback is an error, too
            tally.faults.append((number, f"{type(error).__name__}: {error}"[:300]))
            continue
        tally.ends["refused" if faces is None else "damaged, read" if broken else "valid, read"] += 1
        tally.faces += faces or 0
    return tally


def print_line(text):
    sys.stdout.write(text + "\n")


def main():
    runs, seed = int(os.environ.get("RUNS", "10000")), int(os.environ.get("SEED", "0"))
    wrong = 0
    for suffix in WRITERS:
        begin = time.monotonic()
        tally = run(suffix, runs, seed)
        ends = ", ".join(f"{count} {end}" for end, count in sorted(tally.ends.items()))
        spent = time.monotonic() - begin
        print_line(f"{suffix}: {runs} files in {spent:.0f} s: {ends}; {tally.faces} faces contained")
        print_line(f"  {len(tally.faults)} faults")
        for number, text in tally.faults[:10]:
            print_line(f"  SEED={seed} file {number}: {text}")
        wrong += len(tally.faults)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

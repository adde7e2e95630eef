"""Cells for the benchmarks of the gate."""

import tempfile
from pathlib import Path

import numpy as np
import yaml

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config

CONFIGS = Path(__file__).parent.parent / "configs"


def demo_cell() -> Cell:
    return build_cell(load_config([CONFIGS / "demo.yaml"]))


def crowded_cell(count: int = 1000) -> Cell:
    """Return the demo cell with ``count`` small obstacles around its working area, clear of the robots."""
    rng = np.random.default_rng(1)
    extra = {f"obstacle_{k}": _obstacle(rng, _place_around(rng)) for k in range(count)}
    return _overlaid({"surroundings": extra})


def six_robots(obstacles: int = 200) -> Cell:
    """Return six KR 16 on the floor, 3 m apart in two rows, 36 joints, with obstacles between them."""
    rng = np.random.default_rng(2)
    start = ["0 deg", "-90 deg", "90 deg", "0 deg", "30 deg", "0 deg"]
    robots = {
        f"R{k}": {
            "urdf": str(CONFIGS / "robots" / "kr16.urdf"),
            "base": {"xyz": [3.0 * (k % 3), 3.0 * (k // 3), 0.0]},
            "ignore_pairs": [["link_3", "link_5"]],
            "tool": "tool0",
            "start": start,
            "period": 0.012,
            "link": {"kind": "emulated", "lag": 0.03},
        }
        for k in range(6)
    }
    around = {f"obstacle_{k}": _obstacle(rng, _between(rng)) for k in range(obstacles)}
    floor = {"shape": {"box": [20.0, 20.0, 0.2]}, "xyz": [3.0, 1.5, -0.1]}
    config = {
        "armgate": 1, "name": "six", "stop_distance": 0.05, "self_distance": 0.02,
        "robots": robots, "surroundings": {"floor": floor, **around},
    }  # fmt: skip
    return _built(config)


def _obstacle(rng: np.random.Generator, xyz: np.ndarray) -> dict[str, object]:
    size = float(rng.uniform(0.02, 0.08))
    kinds = ({"sphere": size}, {"box": [size, size, size]}, {"capsule": [size / 2, size]})
    shape = kinds[rng.integers(3)]
    return {"shape": shape, "xyz": [float(x) for x in xyz]}


def _place_around(rng: np.random.Generator) -> np.ndarray:
    """Return a position on a wide ring around the working area, out of reach at the working postures."""
    angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(2.6, 4.5)
    return np.array([1.5 + radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.1, 1.0)])


def _between(rng: np.random.Generator) -> np.ndarray:
    while True:
        xyz = rng.uniform([-2.5, -2.5, 0.1], [8.5, 5.5, 1.2])
        bases = np.array([[3.0 * (k % 3), 3.0 * (k // 3)] for k in range(6)])
        if np.min(np.linalg.norm(bases - xyz[:2], axis=1)) > 1.35:
            return xyz


def _overlaid(overlay: dict[str, object]) -> Cell:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "overlay.yaml"
        path.write_text(yaml.safe_dump(overlay, sort_keys=False), encoding="utf-8")
        return build_cell(load_config([CONFIGS / "demo.yaml", path]))


def _built(config: dict[str, object]) -> Cell:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cell.yaml"
        path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
        return build_cell(load_config([path]))

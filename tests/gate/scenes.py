"""Small hand-written cells for the tests: each has a feature that the others lack."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from support import meshes

CONFIGS = Path(__file__).parents[2] / "configs"


def body(kind: str, *size: float | str, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0)) -> dict[str, Any]:
    return {"kind": kind, "size": size, "xyz": xyz, "rpy": rpy}


def joint(
    parent, kind="revolute", xyz=(0, 0, 0), axis=(0, 0, 1), lower=-2.5, upper=2.5, speed=2.0, bodies=()
):
    return {
        "parent": parent, "kind": kind, "xyz": xyz, "axis": axis,
        "lower": lower, "upper": upper, "speed": speed, "bodies": bodies,
    }  # fmt: skip


def urdf(joints: list[dict[str, Any]], base: tuple[dict[str, Any], ...] = ()) -> str:
    """Return a URDF whose joint k (``Jk``) carries link ``Lk``; a parent is −1 (base) or an earlier joint."""
    links = ["".join(map(_collision, base))] + ["".join(map(_collision, j["bodies"])) for j in joints]
    names = ["base"] + [f"L{k}" for k in range(len(joints))]
    parts = [f'<link name="{name}">{inner}</link>' for name, inner in zip(names, links, strict=True)]
    for k, j in enumerate(joints):
        parts.append(
            f'<joint name="J{k}" type="{j["kind"]}">'
            f'<parent link="{names[j["parent"] + 1]}"/><child link="L{k}"/>'
            f'<origin xyz="{_text(j["xyz"])}"/><axis xyz="{_text(j["axis"])}"/>'
            f'<limit lower="{j["lower"]}" upper="{j["upper"]}" velocity="{j["speed"]}" effort="0"/></joint>'
        )
    parts.append('<link name="tool0"/><joint name="flange" type="fixed">')
    parts.append(f'<parent link="{names[-1]}"/><child link="tool0"/></joint>')
    return f'<robot name="r">{"".join(parts)}</robot>'


def _text(values) -> str:
    return " ".join(str(float(x)) for x in values)


def _collision(b: dict[str, Any]) -> str:
    keys = {
        "sphere": ("radius",), "capsule": ("radius", "length"),
        "cylinder": ("radius", "length"), "cone": ("radius", "length"), "box": ("size",),
        "mesh": ("filename",),
    }[b["kind"]]  # fmt: skip
    values = (_text(b["size"]),) if b["kind"] == "box" else b["size"]
    attributes = " ".join(f'{k}="{v}"' for k, v in zip(keys, values, strict=True))
    return (
        f'<collision><origin xyz="{_text(b["xyz"])}" rpy="{_text(b["rpy"])}"/>'
        f"<geometry><{b['kind']} {attributes}/></geometry></collision>"
    )


def build(
    robots: Mapping[str, dict[str, Any]], files: Mapping[str, bytes] | None = None, **cell: Any
) -> Cell:
    """Return a cell of robots whose ``urdf`` is a text, with other files in the same folder."""
    with tempfile.TemporaryDirectory() as folder:
        for name, data in (files or {}).items():
            (Path(folder) / name).write_bytes(data)
        tree: dict[str, Any] = {"armgate": 1, "name": "scene", "stop_distance": 0.02, "self_distance": 0.01}
        tree |= cell | {"robots": {}}
        for name, robot in robots.items():
            file = Path(folder) / f"{name}.urdf"
            file.write_text(robot["urdf"])
            tree["robots"][name] = robot | {"urdf": file.name}
        path = Path(folder) / "cell.yaml"
        path.write_text(yaml.safe_dump(_plain(tree), sort_keys=False))
        return build_cell(load_config([path]))


def _plain(x: Any) -> Any:
    if isinstance(x, Mapping):
        return {k: _plain(v) for k, v in x.items()}
    if isinstance(x, np.floating):
        return float(x)
    return [_plain(v) for v in x] if isinstance(x, list | tuple) else x


# --- robots -----------------------------------------------------------------------------------------------


def elbow(speed: float = 2.0) -> str:
    """Return four joints: turn, shoulder, elbow, wrist with a bar across; with a body of every shape."""
    along = (0.0, 1.5707963267948966, 0.0)
    return urdf(
        [
            joint(-1, lower=-3.0, upper=3.0, speed=speed, bodies=(body("cylinder", 0.06, 0.16),)),
            joint(0, xyz=(0, 0, 0.15), axis=(0, 1, 0), lower=-1.6, upper=1.6, speed=speed,
                  bodies=(body("capsule", 0.05, 0.3, xyz=(0.2, 0, 0), rpy=along),)),
            joint(1, xyz=(0.4, 0, 0), axis=(0, 1, 0), speed=1.5 * speed,
                  bodies=(body("box", 0.3, 0.06, 0.08, xyz=(0.17, 0, 0)),)),
            joint(2, xyz=(0.35, 0, 0), axis=(1, 0, 0), lower=-3.0, upper=3.0, speed=2 * speed,
                  bodies=(body("capsule", 0.02, 0.24, xyz=(0.06, 0, 0)),
                          body("sphere", 0.03, xyz=(0.1, 0, 0.12)))),
        ],
        base=(body("cylinder", 0.08, 0.1, xyz=(0, 0, -0.03)),),
    )  # fmt: skip


def slide(wrist: float = 2.5) -> str:
    """Return a prismatic joint behind a revolute one, and a wrist behind that."""
    return urdf(
        [
            joint(-1, lower=-3.0, upper=3.0, bodies=(body("box", 0.3, 0.1, 0.1),)),
            joint(0, "prismatic", xyz=(0.2, 0, 0), axis=(1, 0, 0), lower=0.0, upper=0.8, speed=0.8,
                  bodies=(body("box", 0.1, 0.08, 0.08, xyz=(0.15, 0, 0)),)),
            joint(1, xyz=(0.25, 0, 0), axis=(0, 0, 1), lower=-wrist, upper=wrist, speed=3.0,
                  bodies=(body("capsule", 0.03, 0.2, xyz=(0.12, 0, 0), rpy=(0, 1.5707963267948966, 0)),)),
        ]
    )  # fmt: skip


def torso() -> str:
    """Return a tree: two arms of two joints each on one turning trunk."""
    along = (0.0, 1.5707963267948966, 0.0)

    def upper(y: float) -> dict[str, Any]:
        return joint(0, xyz=(0, y, 0.3), bodies=(body("capsule", 0.04, 0.25, xyz=(0.17, 0, 0), rpy=along),))

    def fore(parent: int) -> dict[str, Any]:
        return joint(parent, xyz=(0.35, 0, 0), bodies=(body("box", 0.25, 0.06, 0.06, xyz=(0.15, 0, 0)),))

    trunk = joint(-1, lower=-3.0, upper=3.0, bodies=(body("cylinder", 0.1, 0.4, xyz=(0, 0, 0.1)),))
    return urdf([trunk, upper(0.25), fore(1), upper(-0.25), fore(3)])


def cart(*axes: tuple[float, float, float], speed: float = 1.0, shape=None) -> str:
    """Return prismatic joints that carry one body: straight paths without rotation."""
    shape = shape or body("sphere", 0.05)
    joints = [
        joint(k - 1, "prismatic", axis=a, lower=-2.0, upper=2.0, speed=speed) for k, a in enumerate(axes)
    ]
    joints[-1]["bodies"] = (shape,)
    return urdf(joints)


# --- cells ------------------------------------------------------------------------------------------------


def demo(**changes: Any) -> Cell:
    return build_cell(load_config([CONFIGS / "demo.yaml"]).model_copy(update=changes))


def lagging(cell: Cell, lag: Sequence[float] | float, share: float) -> Cell:
    """Return the cell with these lags declared, and a difference of this share between the axes."""
    lags = lag if isinstance(lag, Sequence) else [lag] * len(cell.robots)
    robots = [
        replace(robot, lags=(own,) * robot.model.n, lag_difference=share * own)
        for robot, own in zip(cell.robots, lags, strict=True)
    ]
    return replace(cell, robots=tuple(robots))


def planar(**changes: Any) -> Cell:
    return build_cell(load_config([CONFIGS / "planar.yaml"]).model_copy(update=changes))


def duel(
    window=(0.0, 0.0), periods=(0.004, 0.012), gap: float = 1.5, tolerance: float = 1e-6, **changes: Any
) -> Cell:
    """Return two elbows face to face on clocks of their own, with a post between them at the side."""
    arms = {
        "A": {"urdf": elbow(), "base": {"xyz": [0, 0, 0.4]}, "start": [0.6, -0.8, 1.2, 0.0],
              "period": periods[0], "lag_window": window[0], "q_tolerance": tolerance},
        "B": {"urdf": elbow(), "base": {"xyz": [gap, 0, 0.4], "rpy": [0, 0, 3.141592653589793]},
              "start": [0.6, -0.8, 1.2, 0.0], "period": periods[1], "lag_window": window[1],
              "q_tolerance": tolerance},
    }  # fmt: skip
    around = {
        "floor": {"shape": {"box": [5, 5, 0.2]}, "xyz": [0.7, 0, -0.1]},
        "post": {"shape": {"cylinder": [0.05, 1.2]}, "xyz": [gap / 2, 0.5, 0.6]},
    }
    return build(arms, surroundings=around, **changes)


def wire(**changes: Any) -> Cell:
    """Return an elbow that can move over, under and around wires of 5 mm."""
    arm = {"urdf": elbow(3.0), "base": {"xyz": [0, 0, 0.5]}, "start": [0.5, -0.6, 1.0, 0.3]}
    around = {
        "upright": {"shape": {"cylinder": [0.0025, 2.0]}, "xyz": [0.55, 0, 0.8]},
        "across": {
            "shape": {"cylinder": [0.0025, 2.0]},
            "xyz": [0.2, 0.6, 0.5],
            "rpy": [0, 1.5707963267948966, 0],
        },
    }
    return build(
        {"A": arm}, surroundings=around, **({"stop_distance": 0.005, "self_distance": 0.005} | changes)
    )


def corner(**changes: Any) -> Cell:
    """Return a sliding arm whose bar turns past the corners of boxes."""
    arm = {"urdf": slide(), "base": {"xyz": [0, 0, 0.5]}, "start": [0.0, 0.2, 0.0], "lag_window": 0.0}
    around = {
        f"box_{k}": {"shape": {"box": [0.3, 0.3, 0.3]}, "xyz": xyz, "rpy": [0, 0, 0.4]}
        for k, xyz in enumerate(([0.9, 0.5, 0.5], [0.9, -0.55, 0.5], [-0.6, 0.6, 0.45]))
    }
    return build({"A": arm}, surroundings=around, **changes)


def tree(**changes: Any) -> Cell:
    """Return two arms on one trunk that can hit each other, and a pole."""
    robot = {"urdf": torso(), "base": {"xyz": [0, 0, 0]}, "start": [0.0, 0.3, -0.2, -0.3, 0.2]}
    around = {"pole": {"shape": {"capsule": [0.05, 0.5]}, "xyz": [0.65, 0, 0.35]}}
    return build({"A": robot}, surroundings=around, **changes)


def lane(period=0.012, response="stop", shape=None, window: float = 0.0, **changes: Any) -> Cell:
    """Return one cart that moves straight toward a wall."""
    robot = {"urdf": cart((1, 0, 0), (0, 1, 0), shape=shape), "start": [-1.0, 0.0], "period": period,
             "lag_window": window, "q_tolerance": 0.0}  # fmt: skip
    wall = {"wall": {"shape": {"box": [0.2, 4.0, 1.0]}, "xyz": [0.6, 0, 0]}}
    return build({"A": robot}, surroundings=wall, response=response, stop_distance=0.05, **changes)


def crossing(window: float = 0.12, tolerance: float = 0.0, periods=(0.012, 0.004)) -> Cell:
    """Return two carts whose paths cross: a delayed one moves out and back while the other moves in."""
    fast = {
        "urdf": cart((1, 0, 0), (0, 1, 0), speed=1.0),
        "start": [-0.5, 0.0],
        "period": periods[0],
        "lag_window": window,
        "q_tolerance": tolerance,
    }
    slow = {"urdf": cart((1, 0, 0), (0, 1, 0), speed=0.4), "start": [0.0, 0.5], "period": periods[1],
            "q_tolerance": tolerance}  # fmt: skip
    return build({"fast": fast, "slow": slow})


def head_on(apart: float = 1.2, periods=(0.004, 0.012), tolerance: float = 0.0, **changes: Any) -> Cell:
    """Return two carts with balls of 5 cm on one line; 2 cm must be kept between them."""
    left, right = (
        {"urdf": cart((1, 0, 0), speed=1.0), "start": [x], "period": T, "q_tolerance": tolerance}
        for x, T in zip((-apart / 2, apart / 2), periods, strict=True)
    )
    return build({"left": left, "right": right}, **changes)


def boom(tolerance: float = 1e-4, window: float = 0.0, **changes: Any) -> Cell:
    """Return a boom of 2 m with a short wrist, measured with noise; bars on both sides, a ball in front."""
    along = (0.0, 1.5707963267948966, 0.0)
    joints = [
        joint(-1, lower=-1.2, upper=1.2, speed=1.0,
              bodies=(body("capsule", 0.04, 1.9, xyz=(1.0, 0, 0), rpy=along),)),
        joint(0, xyz=(2.05, 0, 0), speed=2.0,
              bodies=(body("capsule", 0.03, 0.2, xyz=(0.15, 0, 0), rpy=along),)),
    ]  # fmt: skip
    robot = {"urdf": urdf(joints), "start": [0.2, 0.3], "q_tolerance": tolerance, "lag_window": window}
    around = {
        "left": {"shape": {"capsule": [0.05, 2.0]}, "xyz": [1.2, 1.4, 0], "rpy": [0, along[1], 0.4]},
        "right": {"shape": {"capsule": [0.05, 2.0]}, "xyz": [1.2, -1.4, 0], "rpy": [0, along[1], -0.4]},
        "ball": {"shape": {"sphere": 0.1}, "xyz": [2.6, 0.0, 0]},
    }
    return build({"A": robot}, **({"surroundings": around, "response": "slow"} | changes))


def lever(start: float = 0.2, tolerance: float = 0.0, **changes: Any) -> Cell:
    """Return a slide of 0.8 m behind a revolute joint, and balls that it reaches only beyond its limit."""
    robot = {"urdf": slide(0.3), "start": [0.0, start, 0.0], "q_tolerance": tolerance}
    around = {
        f"ball_{k}": {"shape": {"sphere": 0.1}, "xyz": [1.7 * np.cos(a), 1.7 * np.sin(a), 0]}
        for k, a in enumerate((-2.1, -0.9, 0.8, 2.0))
    }
    return build({"A": robot}, surroundings=around, **({"stop_distance": 0.05} | changes))


def niche(**changes: Any) -> Cell:
    """Return a cart with a ball of 5 cm that can move into a corner of three walls."""
    walls = {
        f"wall_{k}": {"shape": {"box": size}, "xyz": [0.6 * (k == j) for j in range(3)]}
        for k, size in enumerate(([0.2, 2, 2], [2, 0.2, 2], [2, 2, 0.2]))
    }
    robot = {"urdf": cart((1, 0, 0), (0, 1, 0), (0, 0, 1)), "start": [0.0] * 3, "q_tolerance": 1e-5}
    return build({"A": robot}, surroundings=walls, **changes)


def claw() -> str:
    """Return an arm of three joints with a forked mesh and a cone at its end."""
    along = (0.0, 1.5707963267948966, 0.0)
    return urdf(
        [
            joint(-1, lower=-3.0, upper=3.0, bodies=(body("cylinder", 0.06, 0.16),)),
            joint(0, xyz=(0, 0, 0.15), axis=(0, 1, 0), lower=-1.6, upper=1.6,
                  bodies=(body("capsule", 0.05, 0.3, xyz=(0.2, 0, 0), rpy=along),)),
            joint(1, xyz=(0.4, 0, 0), axis=(0, 1, 0), lower=-2.2, upper=2.2, speed=3.0,
                  bodies=(body("mesh", "fork.stl", xyz=(0.1, 0, -0.03)),
                          body("cone", 0.05, 0.12, xyz=(0.0, 0, 0.12)))),
        ],
        base=(body("cone", 0.12, 0.2, xyz=(0, 0, -0.1)),),
    )  # fmt: skip


def fork() -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh of a U of 20 × 16 × 6 cm."""
    return meshes.blocks(meshes.U, (-0.1, -0.06, 0.06, 0.1), (0.0, 0.1, 0.16), (0.0, 0.06))


def frame() -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh of a frame of 60 × 60 × 10 cm with a hole into which an arm may reach."""
    return meshes.blocks(meshes.FRAME, (-0.3, -0.2, 0.2, 0.3), (-0.3, -0.2, 0.2, 0.3), (-0.05, 0.05))


def mesh(**changes: Any) -> Cell:
    """Return an arm with a forked mesh, before a mesh with a hole and cones."""
    arm = {"urdf": claw(), "base": {"xyz": [0, 0, 0.5]}, "start": [0.6, -0.9, 0.8]}
    around = {
        "frame": {
            "shape": {"mesh": {"file": "frame.obj"}}, "xyz": [0.75, 0, 0.7],
            "rpy": [1.5707963267948966, 0, 1.5707963267948966],
        },
        "cone": {"shape": {"cone": [0.1, 0.4]}, "xyz": [0.2, -0.6, 0.5], "rpy": [0.5, 0.3, 0]},
    }  # fmt: skip
    files = {"fork.stl": meshes.stl(*fork()), "frame.obj": meshes.obj(*frame())}
    return build({"A": arm}, files, surroundings=around, **changes)


SCENES: dict[str, Callable[..., Cell]] = {
    "demo": demo, "planar": planar, "duel": duel, "wire": wire, "corner": corner, "tree": tree,
    "mesh": mesh, "boom": boom, "lever": lever,
}  # fmt: skip

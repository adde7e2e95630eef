"""Scene of the experiments: leader, follower, and the positions from which runs start."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import UsageError
from armgate.cell.cell import Robot, build_cell
from armgate.cell.config import load_config
from armgate.control.spheres import Spheres
from armgate.control.view_errors import view_errors

Array = NDArray[np.float64]

SPREAD = (2.6, 0.7, 0.8, 2.5, 1.6, 2.5)
"""Largest distance of a start from the configured one, by joint, rad."""
CLEAR = 0.08
"""Smallest distance of the follower's bounding spheres from the leader and the floor at a start, m."""
CLEAR_ITSELF = 0.025
"""Smallest distance of the follower's bounding spheres from each other at a start, m."""
TRIES = 20_000
"""Number of positions that are tried for a start at a joint limit, ever farther from the configured one."""
NEIGHBOURS = 3
"""Largest number of joints between two spheres that are not checked: they touch anyway, or cannot meet."""
_CARRIAGE = 3


@dataclass(frozen=True)
class Scene:
    """Leader and follower of a cell.

    Attributes:
        configs: Configuration files of the cell.
        follower: Robot that carries the camera.
        leader: Robot whose first three joints are prismatic along the world's axes.
        cell_hash: Hash of the cell.
    """

    configs: tuple[Path, ...]
    follower: Robot
    leader: Robot
    cell_hash: str

    @cached_property
    def spheres(self) -> tuple[Spheres, Spheres]:
        """Bounding spheres of follower and leader."""
        return Spheres.of(self.follower.model), Spheres.of(self.leader.model)

    @property
    def tool(self) -> Array:
        """Position of the leader's tool at its start (3,), m."""
        t: Array = self.leader.model.frame(self.leader.start, self.leader.tool).t
        return t

    def carried(self, tool: Array) -> Array:
        """Return the leader's positions (k, n) for tool positions (k, 3), in its configured posture."""
        q = np.repeat(self.leader.start[None], len(tool), axis=0)
        q[:, :_CARRIAGE] += tool - self.tool
        return q

    def reach(self) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates (3,) of the tool, 2 cm from the joint limits, m."""
        own = self.leader
        low = self.tool + own.lower[:_CARRIAGE] - own.start[:_CARRIAGE] + 0.02
        high = self.tool + own.upper[:_CARRIAGE] - own.start[:_CARRIAGE] - 0.02
        return low, high


def build_scene(configs: tuple[Path, ...]) -> Scene:
    """Build the scene of a cell: its first robot with a camera follows, the first other robot leads.

    Raises:
        ConfigError: The configuration has an error.
        UsageError: A robot is missing, or the leader cannot move its tool along the world's axes.
    """
    cell = build_cell(load_config(configs))
    followers = [robot for robot in cell.robots if robot.camera]
    leaders = [robot for robot in cell.robots if robot not in followers[:1]]
    if not followers or not leaders:
        raise UsageError(f"cell {cell.config.name!r}: expected a robot with a camera, and another robot")
    scene = Scene(configs, followers[0], leaders[0], cell.hash)
    _check_carriage(scene)
    return scene


def _check_carriage(scene: Scene) -> None:
    own = scene.leader
    moved = np.array([0.01, 0.02, -0.03])
    q = np.array(own.start)
    fits = len(q) >= _CARRIAGE and all(joint.kind == "prismatic" for joint in own.model.joints[:_CARRIAGE])
    if fits:
        q[:_CARRIAGE] += moved
        fits = bool(np.allclose(own.model.frame(q, own.tool).t - scene.tool, moved, atol=1e-9))
    if not fits:
        raise UsageError(
            f"robot {own.name!r} cannot lead: expected prismatic joints along x, y and z as its first three"
        )


def off_axis_start(scene: Scene, seed: int) -> Array:
    """Return a clear start (n,) of the follower with the leader's tool 30° to 150° off the view axis."""
    rng, robot = np.random.default_rng(seed), scene.follower
    q: Array
    spread = np.resize(SPREAD, robot.model.n)
    while True:
        q = robot.start + rng.uniform(-1.0, 1.0, robot.model.n) * spread
        if 30.0 < _off_axis(scene, q) < 150.0 and _share(robot, q) < 0.95 and clear(scene, q):
            return q


def limit_starts(scene: Scene, share: float) -> list[Array]:
    """Return starts of the follower (n,): for each limit of each joint, one with that joint near the limit.

    The other joints are as configured. If that is not collision-free, they are moved randomly until it is.
    """
    return [
        _limit_start(scene, joint, sign * share)
        for joint in range(scene.follower.model.n)
        for sign in (-1.0, 1.0)
    ]


def _limit_start(scene: Scene, joint: int, share: float) -> Array:
    robot, rng = scene.follower, np.random.default_rng(joint)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    for spread in np.linspace(0.0, 2.0, TRIES):
        q: Array = robot.start + spread * rng.uniform(-1.0, 1.0, len(half)) * half
        q = np.clip(q, middle - 0.9 * half, middle + 0.9 * half)
        q[joint] = middle[joint] + share * half[joint]
        if clear(scene, q):
            return q
    raise UsageError(
        f"no clear start of {robot.name} was found with joint {joint} at {share:g} of its half range"
    )


def _off_axis(scene: Scene, q: Array) -> float:
    """Return the angle between the view axis at q (n,) and the leader's tool, degrees."""
    robot = scene.follower
    return float(np.degrees(view_errors(robot.model, str(robot.camera), q, scene.tool, 1.0)[0]))


def _share(robot: Robot, q: Array) -> float:
    middle, half = 0.5 * (robot.upper + robot.lower), 0.5 * (robot.upper - robot.lower)
    return float((np.abs(q - middle) / half).max())


def clear(scene: Scene, q: Array) -> bool:
    """Return True if the follower at q (n,) is certainly clear of the floor, the leader and itself."""
    spheres, others = scene.spheres
    centres, around = spheres.centres(q), others.centres(scene.leader.start)
    if (centres[:, 2] - spheres.radii)[np.array(spheres.joints) > 0].min() < CLEAR:
        return False
    if _gaps(centres, spheres.radii, around, others.radii).min() < CLEAR:
        return False
    joints = np.array(spheres.joints)
    apart = np.abs(joints[:, None] - joints) > NEIGHBOURS
    return bool(_gaps(centres, spheres.radii, centres, spheres.radii)[apart].min() > CLEAR_ITSELF)


def _gaps(a: Array, ra: Array, b: Array, rb: Array) -> Array:
    gaps: Array = np.linalg.norm(a[:, None] - b, axis=2) - ra[:, None] - rb
    return gaps

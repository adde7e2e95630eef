"""Pairs of bodies that must stay apart."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from armgate.cell.bodies import Body
from armgate.cell.config import CellConfig
from armgate.cell.model import ModelBody, RobotModel
from armgate.cell.names import whole_name

PairKind = Literal["self", "robots", "surroundings"]


@dataclass(frozen=True)
class Pair:
    """Two bodies that must keep a clearance of at least ``limit`` [m].

    Attributes:
        a: Index of the first body in ``cell.bodies``: of the first robot, or nearer to the base.
        b: Index of the second body in ``cell.bodies``, which may be part of the surroundings.
        limit: Smallest clearance, m.
        kind: Bodies of one robot, of two robots, or of a robot and the surroundings.
    """

    a: int
    b: int
    limit: float
    kind: PairKind


def collect_pairs(
    config: CellConfig, models: Sequence[RobotModel], bodies: Sequence[Body]
) -> tuple[Pair, ...]:
    """Return all pairs that must stay apart.

    Pairs that cannot move relative to each other are left out. So are bodies of one robot on the same joint
    or on neighbouring joints, because they overlap at the joint, and the pairs of ``ignore_pairs``.

    Raises:
        ConfigError: A name in ``ignore_pairs`` is neither that of a link or body of the robot nor (as the
            second of a pair) in the surroundings.
    """
    ignored: set[frozenset[str]] = set()
    for name, model in zip(config.robots, models, strict=True):
        ignored |= _ignored(config, name, model, bodies)
    return tuple(_pairs(config, models, bodies, ignored))


def _pairs(
    config: CellConfig, models: Sequence[RobotModel], bodies: Sequence[Body], ignored: set[frozenset[str]]
) -> Iterator[Pair]:
    for a, b in combinations(range(len(bodies)), 2):
        first, second = bodies[a], bodies[b]
        if not (_moves(models, first) or _moves(models, second)):
            continue
        if frozenset((first.name, second.name)) in ignored:
            continue
        if second.robot is None:
            yield Pair(a, b, config.stop_distance, "surroundings")
        elif first.robot != second.robot:
            yield Pair(a, b, config.stop_distance, "robots")
        else:
            yield from _self_pair(config, models[second.robot], a, b, (first, second))


def _self_pair(
    config: CellConfig, model: RobotModel, a: int, b: int, both: tuple[Body, Body]
) -> Iterator[Pair]:
    joint_a, joint_b = (model.bodies[body.index].joint for body in both)
    if joint_a == joint_b or _parent(model, joint_a) == joint_b or _parent(model, joint_b) == joint_a:
        return
    a, b = (a, b) if joint_a < joint_b else (b, a)
    yield Pair(a, b, config.self_distance, "self")


def _parent(model: RobotModel, joint: int) -> int | None:
    return None if joint < 0 else model.parents[joint]


def _moves(models: Sequence[RobotModel], body: Body) -> bool:
    return body.robot is not None and models[body.robot].bodies[body.index].joint >= 0


def _ignored(
    config: CellConfig, robot: str, model: RobotModel, bodies: Sequence[Body]
) -> set[frozenset[str]]:
    """Return the pairs of body names that a robot's ``ignore_pairs`` excludes."""
    ignored: set[frozenset[str]] = set()
    for number, names in enumerate(config.robots[robot].ignore_pairs):
        first, second = (
            _bodies_named(config, (robot, number, i), name, model, bodies) for i, name in enumerate(names)
        )
        ignored.update(frozenset((a, b)) for a in first for b in second)
    return ignored


def _bodies_named(
    config: CellConfig, at: tuple[str, int, int], name: str, model: RobotModel, bodies: Sequence[Body]
) -> list[str]:
    """Return the full names of the bodies that a name in ``ignore_pairs`` selects."""
    robot, number, i = at
    found = [f"{robot}/{body.name}" for body in model.bodies if name in (whole_name(body.name), body.link)]
    if not found and i == 1 and name in config.surroundings:
        found = [body.name for body in bodies if body.robot is None and whole_name(body.name) == name]
    if not found:
        raise config.error(
            ("robots", robot, "ignore_pairs", number, i),
            f"no body of the robot, and no link with a body, is called {name!r}; expected "
            f"{_known_names(model.bodies)}; the second of a pair may also be in the surroundings",
        )
    return found


def _known_names(bodies: Sequence[ModelBody]) -> str:
    names = dict.fromkeys(name for body in bodies for name in (body.link, whole_name(body.name)))
    return "one of " + ", ".join(names)

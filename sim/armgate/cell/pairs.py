"""Bodies of a cell, and which of them must stay apart."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from armgate.cell.config import CellConfig
from armgate.cell.configured_parts import parts_of_shape
from armgate.cell.errors import ModelError
from armgate.cell.findings import Findings
from armgate.cell.model import ModelBody, RobotModel
from armgate.cell.names import MAX_NAME, part_name, whole_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape

PairKind = Literal["self", "robots", "surroundings"]


@dataclass(frozen=True)
class Body:
    """A body of the cell.

    Attributes:
        name: ``FR/link_3``, or a surrounding's name; with ``/1``, ``/2``… for the convex parts of a mesh.
        robot: Index of its robot, None for a surrounding.
        index: Its index in that robot's ``model.bodies``, or in ``cell.surroundings``.
        shape: Its shape.
        placement: In its joint's frame (as ``ModelBody``), or in the world.
    """

    name: str
    robot: int | None
    index: int
    shape: Shape
    placement: Placement


@dataclass(frozen=True)
class Pair:
    """Two bodies that must stay at least ``limit`` [m] apart.

    ``a`` and ``b`` are indices into ``cell.bodies``: a's robot comes first, or a is nearer to the base, or
    b is a surrounding.
    """

    a: int
    b: int
    limit: float
    kind: PairKind


@dataclass(frozen=True)
class StandingPart:
    """A part of one of the surroundings: its name and its place in the world."""

    whole: str
    name: str
    shape: Shape
    placement: Placement


def collect_surroundings(config: CellConfig, outline: bool, findings: Findings) -> tuple[StandingPart, ...]:
    """Return the parts of all surroundings; what cannot be used goes into the findings."""
    parts: list[StandingPart] = []
    for name in config.surroundings:
        with findings.collecting():
            parts += _standing(config, name, outline)
    return tuple(parts)


def collect_bodies(
    config: CellConfig, models: Sequence[RobotModel], surroundings: Sequence[StandingPart]
) -> tuple[Body, ...]:
    """Return the bodies of all robots, robot by robot, then the surroundings.

    Raises:
        ConfigError: A robot's and its body's name are too long together, or a name stands for two bodies.
    """
    bodies = []
    for robot, (name, model) in enumerate(zip(config.robots, models, strict=True)):
        for index, body in enumerate(model.bodies):
            full = f"{name}/{body.name}"
            _check_length(config, ("robots", name), full)
            bodies.append(Body(full, robot, index, body.shape, body.placement))
    taken = {body.name for body in bodies}
    for index, part in enumerate(surroundings):
        if part.name in taken:
            raise config.error(
                ("surroundings", part.whole), f"{part.name!r} is the name of a robot's body too"
            )
        bodies.append(Body(part.name, None, index, part.shape, part.placement))
    return tuple(bodies)


def _standing(config: CellConfig, name: str, outline: bool) -> Iterator[StandingPart]:
    own, key = config.surroundings[name], ("surroundings", name)
    try:
        parts = parts_of_shape(own.shape, config.file((*key, "shape", "mesh", "file"), ""), {}, outline)
    except ModelError as error:
        raise config.error(key, str(error)) from error
    for number, part in enumerate(parts, start=1):
        body_name = part_name(name, number, len(parts))
        _check_length(config, key, body_name)
        placement = Placement(own.placement.R, own.placement.apply(part.at))
        yield StandingPart(name, body_name, part.shape, placement)


def _check_length(config: CellConfig, key: tuple[str, str], name: str) -> None:
    if len(name) > MAX_NAME:
        text = f"the body's name {name!r} is too long; expected at most {MAX_NAME} characters"
        raise config.error(key, text)


def collect_pairs(
    config: CellConfig, models: Sequence[RobotModel], bodies: Sequence[Body]
) -> tuple[Pair, ...]:
    """All pairs that must stay apart.

    Left out are pairs that cannot move against each other, bodies of one robot on the same joint or on
    neighbouring ones (they overlap where the joint is), and what ``ignore_pairs`` names.

    Raises:
        ConfigError: ``ignore_pairs`` names neither a link nor a body of its robot, nor a surrounding.
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
    """Pairs of names of bodies that a robot's ``ignore_pairs`` names."""
    ignored: set[frozenset[str]] = set()
    for number, names in enumerate(config.robots[robot].ignore_pairs):
        first, second = (
            _named(config, (robot, number, i), name, model, bodies) for i, name in enumerate(names)
        )
        ignored.update(frozenset((a, b)) for a in first for b in second)
    return ignored


def _named(
    config: CellConfig, at: tuple[str, int, int], name: str, model: RobotModel, bodies: Sequence[Body]
) -> list[str]:
    """The bodies, as the cell calls them, of a link or body of the robot, or the surrounding of this name."""
    robot, number, i = at
    found = [f"{robot}/{body.name}" for body in model.bodies if name in (whole_name(body.name), body.link)]
    if not found and i == 1 and name in config.surroundings:
        found = [body.name for body in bodies if body.robot is None and whole_name(body.name) == name]
    if not found:
        raise config.error(
            ("robots", robot, "ignore_pairs", number, i),
            f"no link with a body, no body and (second of a pair) no surrounding is called {name!r}; "
            f"expected {_known(model.bodies)}",
        )
    return found


def _known(bodies: Sequence[ModelBody]) -> str:
    names = dict.fromkeys(name for body in bodies for name in (body.link, whole_name(body.name)))
    return "one of " + ", ".join(names)

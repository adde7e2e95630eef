"""Bodies of a cell: those of the robots, then those of the surroundings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.cell.config import CellConfig, ShapeConfig
from armgate.cell.errors import ErrorCollector, ModelError
from armgate.cell.model import RobotModel
from armgate.cell.names import MAX_NAME, part_name
from armgate.cell.placement import Placement
from armgate.cell.shapes import Shape, ShapePart


@dataclass(frozen=True)
class Body:
    """Body of the cell.

    Attributes:
        name: ``FR/link_3``, or the name of a body of the surroundings; with ``/1``, ``/2``… for the convex
            parts of a mesh.
        robot: Index of its robot, None for the surroundings.
        index: Index in that robot's ``model.bodies``, or in ``cell.surroundings``.
        shape: Shape of the body.
        placement: Placement in its joint's frame (as ``ModelBody``), or in the world.
    """

    name: str
    robot: int | None
    index: int
    shape: Shape
    placement: Placement


@dataclass(frozen=True)
class SurroundingPart:
    """Part of a body of the surroundings.

    Attributes:
        whole: Name of the body.
        name: Name of the part.
        shape: Shape of the part.
        placement: Placement in the world.
    """

    whole: str
    name: str
    shape: Shape
    placement: Placement


def parts_of_shape(
    shape: ShapeConfig, folder: Path, packages: Mapping[str, Path], outline: bool = False
) -> tuple[ShapePart, ...]:
    """Return the parts of a configured shape: one primitive, or the convex parts of a mesh.

    Args:
        shape: The shape.
        folder: Folder from which relative file names start.
        packages: Folders for ``package://``.
        outline: If true, check a mesh without cutting it: a small sphere replaces its parts.

    Raises:
        ModelError: A mesh cannot be used; the text names its file.
    """
    if shape.mesh is None:
        return (ShapePart(shape.shape),)
    from armgate.cell.mesh.convex_parts import (  # noqa: PLC0415  (most cells have no meshes)
        convex_parts,
        decomposition_options,
    )
    from armgate.cell.mesh.locate import locate  # noqa: PLC0415

    file = locate(shape.mesh.file, folder, packages)
    return convex_parts(file, shape.mesh.scale, decomposition_options(shape.mesh), outline)


def collect_surroundings(
    config: CellConfig, outline: bool, errors: ErrorCollector
) -> tuple[SurroundingPart, ...]:
    """Return the parts of all surroundings, and collect the errors of unusable ones."""
    parts: list[SurroundingPart] = []
    for name in config.surroundings:
        with errors.collecting():
            parts += _surrounding_parts(config, name, outline)
    return tuple(parts)


def _surrounding_parts(config: CellConfig, name: str, outline: bool) -> Iterator[SurroundingPart]:
    own, key = config.surroundings[name], ("surroundings", name)
    try:
        parts = parts_of_shape(own.shape, config.file((*key, "shape", "mesh", "file"), ""), {}, outline)
    except ModelError as error:
        raise config.error(key, str(error)) from error
    for number, part in enumerate(parts, start=1):
        body_name = part_name(name, number, len(parts))
        _check_length(config, key, body_name)
        placement = Placement(own.placement.R, own.placement.apply(part.position))
        yield SurroundingPart(name, body_name, part.shape, placement)


def collect_bodies(
    config: CellConfig, models: Sequence[RobotModel], surroundings: Sequence[SurroundingPart]
) -> tuple[Body, ...]:
    """Return the bodies of all robots, robot by robot, then the surroundings.

    Raises:
        ConfigError: A robot's and its body's name are too long together, or two bodies have the same name.
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
                ("surroundings", part.whole), f"{part.name!r} is also the name of a robot's body"
            )
        bodies.append(Body(part.name, None, index, part.shape, part.placement))
    return tuple(bodies)


def _check_length(config: CellConfig, key: tuple[str, str], name: str) -> None:
    if len(name) > MAX_NAME:
        text = f"the body's name {name!r} is too long; expected at most {MAX_NAME} characters"
        raise config.error(key, text)

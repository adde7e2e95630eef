"""Bounds, start and lags of one robot: the limits of the URDF, tightened by the configuration."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from armgate.cell.config import CellConfig, JointConfig
from armgate.cell.config.units import UNITS, Quantity
from armgate.cell.config.yaml_tree import KeyPath
from armgate.cell.errors import ErrorCollector
from armgate.cell.model import Joint, RobotModel
from armgate.cell.urdf import MAX_NUMBER
from armgate.cell.urdf.gantry import GANTRY_JOINTS

Array = NDArray[np.float64]

RAMP = 0.25
"""Time in which a joint reaches full speed with the default acceleration and deceleration, s.

It is equal for all joints, because they brake together: the longest ramp determines the length of a stop."""

LAG_DIFFERENCE_SHARE = 0.1
"""Default difference between the lags of a real robot's axes, as a share of its link's `lag`.

The position loops of one controller are tuned to equal lags, so they differ by a few percent."""

_DIMENSIONS = {"revolute": "angle", "prismatic": "length"}


@dataclass(frozen=True, eq=False)
class JointBounds:
    """Bounds of a robot's joints, (n,) each, read-only; rad or m, per s, per s²."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    deceleration: Array


def joint_bounds(config: CellConfig, robot: str, model: RobotModel) -> JointBounds:
    """Return the bounds of a robot.

    Raises:
        ConfigError: A joint is unknown, a unit is wrong, or a bound is looser than the URDF's; a line for
            each.
    """
    names, errors = [joint.name for joint in model.joints], ErrorCollector()
    for name in config.robots[robot].joints:
        with errors.collecting():
            if name not in names:
                text = f"robot {robot} has no joint {name!r}; expected one of {', '.join(names)}"
                raise config.error(("robots", robot, "joints", name), text)
    rows = []
    for joint in model.joints:
        with errors.collecting():
            rows.append(_row(config, robot, joint))
    errors.check()
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    for column in columns:
        column.setflags(write=False)
    return JointBounds(
        **{field.name: column for field, column in zip(fields(JointBounds), columns, strict=True)}
    )


def start_position(config: CellConfig, robot: str, model: RobotModel) -> Array:
    """Return the start position; it may be outside the limits (the gate then admits retreat only).

    Raises:
        ConfigError: The number of values differs from that of joints, or a unit is wrong.
    """
    start, path = config.robots[robot].start, ("robots", robot, "start")
    if len(start) != model.n:
        names = ", ".join(joint.name for joint in model.joints)
        raise config.error(path, f"{len(start)} values; expected {model.n}, one for each of {names}")
    values, errors = [], ErrorCollector()
    for i, (given, joint) in enumerate(zip(start, model.joints, strict=True)):
        with errors.collecting():
            values.append(_value(config, (*path, i), given, joint, ""))
    errors.check()
    array = np.array(values)
    array.setflags(write=False)
    return array


def joint_lags(config: CellConfig, robot: str, model: RobotModel) -> tuple[float, ...]:
    """Return the time constants with which a robot's joints follow their setpoints, from its link, s.

    Raises:
        ConfigError: ``lags`` names an unknown joint.
    """
    link, names = config.robots[robot].link, [joint.name for joint in model.joints]
    own = link.joint_lags
    for name in own:
        if name not in names:
            text = f"robot {robot} has no joint {name!r}; expected one of {', '.join(names)}"
            raise config.error(("robots", robot, "link", "lags", name), text)
    return tuple(own.get(name, link.lag) for name in names)


def lag_difference(config: CellConfig, robot: str, lags: tuple[float, ...]) -> float:
    """Return the largest difference between the lags of two joints that the gate allows for, s.

    If it is not declared, it is that of the emulated joints, or `LAG_DIFFERENCE_SHARE` of a real robot's lag.
    """
    own = config.robots[robot]
    if own.lag_difference is not None:
        return own.lag_difference
    return max(lags) - min(lags) if own.link.EXACT_LAGS else LAG_DIFFERENCE_SHARE * own.link.lag


def _row(config: CellConfig, robot: str, joint: Joint) -> tuple[float, ...]:
    """Return lower, upper, velocity, acceleration and deceleration of one joint."""
    path = ("robots", robot, "joints", joint.name)
    own = config.robots[robot].joints.get(joint.name, JointConfig())
    lower = joint.lower if own.lower is None else _value(config, (*path, "lower"), own.lower, joint, "")
    upper = joint.upper if own.upper is None else _value(config, (*path, "upper"), own.upper, joint, "")
    _check_limits(config, path, joint, lower, upper)
    velocity = _velocity(config, path, own, joint)
    default = _gantry_acceleration(config, robot, joint) or velocity / RAMP
    acceleration = _acceleration(config, path, own, joint, default)
    return lower, upper, velocity, acceleration, _deceleration(config, path, own, joint, default)


def _check_limits(config: CellConfig, path: KeyPath, joint: Joint, lower: float, upper: float) -> None:
    if lower < joint.lower:
        text = f"{lower:g} is looser than the URDF's {joint.lower:g}; expected the same or more"
        raise config.error((*path, "lower"), text)
    if upper > joint.upper:
        text = f"{upper:g} is looser than the URDF's {joint.upper:g}; expected the same or less"
        raise config.error((*path, "upper"), text)
    if lower >= upper:
        raise config.error(path, f"lower {lower:g} is not below upper {upper:g}; expected room in between")


def _velocity(config: CellConfig, path: KeyPath, own: JointConfig, joint: Joint) -> float:
    if own.velocity is None:
        return joint.velocity
    path = (*path, "velocity")
    velocity = _value(config, path, own.velocity, joint, "/s")
    if not 0.0 < velocity <= joint.velocity:
        text = f"{velocity:g} is not possible; expected more than 0 and at most the URDF's {joint.velocity:g}"
        raise config.error(path, text)
    return velocity


def _gantry_acceleration(config: CellConfig, robot: str, joint: Joint) -> float | None:
    gantry = config.robots[robot].gantry
    return gantry.acceleration if gantry is not None and joint.name in GANTRY_JOINTS else None


def _acceleration(config: CellConfig, path: KeyPath, own: JointConfig, joint: Joint, default: float) -> float:
    if own.acceleration is None:
        return min(default, joint.acceleration)
    return _at_most(config, (*path, "acceleration"), own.acceleration, joint, joint.acceleration)


def _deceleration(config: CellConfig, path: KeyPath, own: JointConfig, joint: Joint, default: float) -> float:
    """Return the deceleration; inf if the configuration has ``deceleration: null``."""
    path = (*path, "deceleration")
    if own.deceleration is not None:
        return _at_most(config, path, own.deceleration, joint, joint.deceleration)
    if "deceleration" not in own.model_fields_set:
        return min(default, joint.deceleration)
    if math.isinf(joint.deceleration):
        return math.inf
    text = f"no bound is looser than the URDF's {joint.deceleration:g}; expected the same or less"
    raise config.error(path, text)


def _at_most(config: CellConfig, path: KeyPath, given: Quantity, joint: Joint, most: float) -> float:
    """Return an acceleration or deceleration, which must be positive and at most the URDF's."""
    value = _value(config, path, given, joint, "/s²")
    if value <= 0.0:
        raise config.error(path, f"{value:g} is not possible; expected more than 0")
    if value > most:
        raise config.error(path, f"{value:g} is looser than the URDF's {most:g}; expected the same or less")
    return value


def _value(config: CellConfig, path: KeyPath, given: Quantity, joint: Joint, per: str) -> float:
    dimension = _DIMENSIONS[joint.kind] + per
    if not given.fits(dimension):
        text = f"{given.given!r} does not fit joint {joint.name}, which is {joint.kind}"
        raise config.error(path, f"{text}; expected {UNITS[dimension]}")
    if abs(given.value) > MAX_NUMBER:
        raise config.error(path, f"{given.value:g} is out of range; expected a number within ±{MAX_NUMBER:g}")
    return given.value

"""Setup of an RSI link: everything that it needs of a cell's configuration and the KRC's own file."""

import ipaddress
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.events import Joints
from armgate.links.rsi.axes import Axis, axes_of
from armgate.links.rsi.config import RsiLinkConfig
from armgate.links.rsi.ethernet_checks import file_objection, is_host, unsent_values
from armgate.links.rsi.ethernet_file import Ethernet, EthernetError, load_ethernet
from armgate.links.rsi.probe import probe_size
from armgate.links.rsi.telegram import ReplyWriter

if TYPE_CHECKING:  # the model of a robot takes time to load
    from armgate.cell.cell import Cell, Robot
    from armgate.cell.config import CellConfig

Address = tuple[str, int]
_DEFAULT_AXISCORR = 5.0
"""KUKA's default of AXISCORR, deg or mm."""


@dataclass(frozen=True)
class Setup:
    """Robot and KRC of a link. Positions are in rad and m, in the order of the model.

    Attributes:
        robot: Name of the robot.
        period: Cycle of the KRC, s.
        axes: The axis of each joint.
        lower: Lower joint limits.
        upper: Upper joint limits.
        speed: Largest speeds, per s.
        acceleration: Smaller of the largest acceleration and deceleration of each joint, per s².
        lag: Time constant with which the measured position follows, s.
        tolerance: Largest distance of each resting joint from its setpoint.
        reach: Largest correction of each joint that AXISCORR passes; inf: not known.
        writer: Writer of replies.
        relative: True if corrections are added up.
        programmed: True if corrections count from ASPos, False if from AIPos of the resting robot.
        unsent: Values that the KRC reads and that no reply carries.
        precision: Decimals of the values in telegrams.
        timeout: Delay at which the link becomes faulted.
        late_in_a_row: Number of successive late cycles at which it becomes faulted.
        silence: Time without a telegram after which it is lost, s.
        krc: Address from which telegrams come.
        listen: Address and port to listen on.
        pc: IP_NUMBER of the KRC's file.
    """

    robot: str
    period: float
    axes: tuple[Axis, ...]
    lower: Joints
    upper: Joints
    speed: Joints
    acceleration: Joints
    lag: float
    tolerance: Joints
    reach: Joints
    writer: ReplyWriter
    relative: bool
    programmed: bool
    unsent: tuple[str, ...]
    precision: int
    timeout: int
    late_in_a_row: int
    silence: float
    krc: str
    listen: Address
    pc: str


def setup_of(cell: "Cell", robot: "Robot") -> Setup:
    """Return the setup of a robot whose link is of the kind ``rsi``.

    Raises:
        ConfigError: The KRC's file, or a value, does not fit; the text names file, line and key.
    """
    own, key = robot.config.link, ("robots", robot.name, "link")
    if not isinstance(own, RsiLinkConfig):
        raise cell.config.error((*key, "kind"), f"{own.kind!r}; expected rsi")
    try:
        axes = joint_axes(robot, own)
    except ValueError as error:
        raise cell.config.error((*key, "axes"), str(error)) from error
    ethernet = _ethernet(cell.config, robot.name, own, axes)
    setup = Setup(
        robot=robot.name,
        period=robot.period,
        axes=axes,
        lower=_row(robot.lower),
        upper=_row(robot.upper),
        speed=_row(robot.velocity),
        acceleration=tuple(map(min, _row(robot.acceleration), _row(robot.deceleration))),
        lag=own.lag,
        tolerance=tuple(own.length_tolerance if axis.linear else own.angle_tolerance for axis in axes),
        reach=_reach(own, axes),
        writer=ReplyWriter(ethernet, axes),
        relative=own.mode == "relative",
        programmed=own.reference == "programmed",
        unsent=unsent_values(ethernet),
        precision=own.precision,
        timeout=own.timeout,
        late_in_a_row=own.late_in_a_row,
        silence=own.silence,
        krc=own.krc,
        listen=_listen(cell.config, robot.name, own, ethernet),
        pc=ethernet.host,
    )
    _check(cell, robot, setup)
    return setup


def joint_axes(robot: "Robot", own: RsiLinkConfig) -> tuple[Axis, ...]:
    """Return the axis of each joint, in the order of the model.

    Raises:
        ValueError: They do not fit; the text names what was expected.
    """
    joints = [(joint.name, joint.kind == "prismatic") for joint in robot.model.joints]
    return axes_of(joints, {name: (axis.joint, axis.received, axis.sent) for name, axis in own.axes.items()})


def uncovered(setup: Setup, reference: Joints) -> str | None:
    """Return an objection to a joint with limits beyond AXISCORR around a programmed position, else None."""
    rows = zip(setup.axes, reference, setup.lower, setup.upper, setup.reach, strict=True)
    for axis, origin, lower, upper, reach in rows:
        if lower < origin - reach or upper > origin + reach:
            low, high, at, far = (axis.shown * one for one in (lower, upper, origin, reach))
            return (
                f"{axis.joint} ({axis.name}) may go from {low:.1f} to {high:.1f} {axis.unit}, but AXISCORR "
                f"silently limits it to ±{far:g} around {at:.1f}: widen AXISCORR and axiscorr, or "
                "narrow the joint"
            )
    return None


def warnings_of(setup: Setup) -> list[str]:
    """Return warnings about settings in the KRC's file that are valid, but probably not intended."""
    names = ", ".join(setup.unsent)
    unsent = (
        f"RECEIVE declares {names}, which armgate never sends: the KRC reads 0 (an override of 0 %, if it is "
        "connected to one); remove it from RECEIVE and from the signal flow unless 0 is meant"
    )
    address = (
        f"IP_NUMBER {setup.pc!r} in the KRC's file is not the address of a PC: the KRC would send nothing "
        "here; write this PC's address there"
    )
    return [*([unsent] if setup.unsent else []), *([] if is_host(setup.pc) else [address])]


def _row(values: object) -> Joints:
    return tuple(float(value) for value in values)  # type: ignore[attr-defined]


def _ethernet(config: "CellConfig", robot: str, own: RsiLinkConfig, axes: tuple[Axis, ...]) -> Ethernet:
    key = ("robots", robot, "link", "ethernet")
    path: Path = config.file(key, own.ethernet)
    try:
        ethernet = load_ethernet(path)
    except EthernetError as error:
        raise config.error(key, str(error)) from error
    objection = file_objection(
        ethernet, axes, programmed=own.reference == "programmed", relative=own.mode == "relative"
    )
    if objection is not None:
        raise config.error(key, f"{path}: {objection}")
    return ethernet


def _reach(own: RsiLinkConfig, axes: tuple[Axis, ...]) -> Joints:
    if own.axiscorr is None:
        return (math.inf,) * len(axes)
    given = {str(name): value for name, value in own.axiscorr.items()}
    return tuple(
        given.get(axis.name, given.get(axis.name[0], _DEFAULT_AXISCORR)) / abs(axis.sent) for axis in axes
    )


def _listen(config: "CellConfig", robot: str, own: RsiLinkConfig, ethernet: Ethernet) -> Address:
    if own.listen is None:
        if is_host(ethernet.host):
            return str(ipaddress.ip_address(ethernet.host)), ethernet.port
        key = ("robots", robot, "link", "ethernet")
        text = f"IP_NUMBER {ethernet.host!r} is not the address of a PC; expected this PC's, or link.listen"
        raise config.error(key, f"{own.ethernet}: {text}")
    host, _, port = own.listen.rpartition(":")
    return host.strip("[]"), int(port)


def _check(cell: "Cell", robot: "Robot", setup: Setup) -> None:
    """Check the setup.

    Raises:
        ConfigError: AXISCORR, lag_window, q_tolerance or precision do not fit.
    """
    key = ("robots", robot.name)
    objection = uncovered(setup, _row(robot.start))
    if objection is not None:
        raise cell.config.error((*key, "link", "axiscorr"), objection)
    if robot.lag_window < 2.0 * robot.period:
        text = (
            f"a KRC acts on a reply one cycle after it is sent, and telegrams jitter; "
            f"expected lag_window to be at least two cycles ({2000.0 * robot.period:g} ms)"
        )
        raise cell.config.error((*key, "lag_window"), text)
    coarsest = max(abs(axis.read) for axis in setup.axes) * 0.5 * 10.0**-setup.precision
    if robot.q_tolerance < coarsest:
        text = (
            f"values with {setup.precision} decimals are rounded by up to {coarsest:.2g} rad or m; "
            f"expected q_tolerance to be no smaller than that, or a higher Precision on the KRC"
        )
        raise cell.config.error((*key, "q_tolerance"), text)
    invisible = probe_size(setup).objection(setup.axes, setup.precision)
    if invisible is not None:
        raise cell.config.error((*key, "link", "precision"), invisible)

"""All that an RSI link is built with, and how it follows from a cell's configuration."""

import ipaddress
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armgate.cell.link_config import RsiLinkConfig
from armgate.events import Joints
from armgate.links.rsi.axes import AXES, Axis, axes_of
from armgate.links.rsi.ethernet_file import Ethernet, EthernetError, Received, load_ethernet
from armgate.links.rsi.probe import shape_of
from armgate.links.rsi.telegram import LONGEST_REPLY, ReplyWriter

if TYPE_CHECKING:  # what a robot model needs takes time to load
    from armgate.cell.cell import Cell, Robot
    from armgate.cell.config import CellConfig

Address = tuple[str, int]


@dataclass(frozen=True)
class Setup:
    """What a link has to know of its robot and KRC. Positions are in rad and m, in the order of the model.

    Attributes:
        robot: Its name.
        period: The KRC's cycle, s.
        axes: The axis of each joint.
        lower: Joint limits.
        upper: Joint limits.
        speed: Largest speeds, per s.
        acceleration: Largest accelerations and decelerations, the smaller one of both, per s².
        lag: Time constant with which the measured position follows, s.
        tolerance: How far each resting joint may be from where it should be.
        reach: How far AXISCORR lets each joint be corrected; inf: not known.
        writer: Writes replies.
        relative: Whether corrections are added up.
        programmed: True if corrections count from ASPos, False if from AIPos of the resting robot.
        unsent: Values that the KRC takes and that no reply carries.
        precision: Decimals of the values in telegrams.
        timeout: At this Delay the link gives up.
        late_in_a_row: At so many late cycles in a row too.
        silence: After how long without a telegram it is lost, s.
        krc: Address from which telegrams come.
        listen: Where to listen.
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
    """The setup of a robot whose link is of the kind ``rsi``.

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
    reach = _reach(own, axes)
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
        reach=reach,
        writer=ReplyWriter(ethernet, axes),
        relative=own.mode == "relative",
        programmed=own.reference == "programmed",
        unsent=_unsent(ethernet),
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


def uncovered(setup: Setup, reference: Joints) -> str | None:
    """Which joint's limits AXISCORR keeps the KRC from reaching, from a programmed position, if one's."""
    rows = zip(setup.axes, reference, setup.lower, setup.upper, setup.reach, strict=True)
    for axis, origin, lower, upper, reach in rows:
        if lower < origin - reach or upper > origin + reach:
            low, high, at, far = (axis.shown * one for one in (lower, upper, origin, reach))
            return (
                f"{axis.joint} ({axis.name}) may go from {low:.1f} to {high:.1f} {axis.unit}, but AXISCORR "
                f"cuts silently at ±{far:g} around {at:.1f}: widen AXISCORR and axiscorr, or narrow the joint"
            )
    return None


def _row(values: object) -> Joints:
    return tuple(float(value) for value in values)  # type: ignore[attr-defined]


def joint_axes(robot: "Robot", own: RsiLinkConfig) -> tuple[Axis, ...]:
    """The axis of each joint, in the order of the model.

    Raises:
        ValueError: They do not fit; says what was expected.
    """
    joints = [(joint.name, joint.kind == "prismatic") for joint in robot.model.joints]
    return axes_of(joints, {name: (axis.joint, axis.received, axis.sent) for name, axis in own.axes.items()})


def _ethernet(config: "CellConfig", robot: str, own: RsiLinkConfig, axes: tuple[Axis, ...]) -> Ethernet:
    key = ("robots", robot, "link", "ethernet")
    path: Path = config.file(key, own.ethernet)
    try:
        ethernet = load_ethernet(path)
    except EthernetError as error:
        raise config.error(key, str(error)) from error
    objection = (
        _sent_objection(ethernet, axes, own.reference == "programmed")
        or _received_objection(ethernet, axes, own.mode == "relative")
        or _length_objection(ReplyWriter(ethernet, axes), len(axes))
    )
    if objection is not None:
        raise config.error(key, f"{path}: {objection}")
    return ethernet


def _sent_objection(ethernet: Ethernet, axes: tuple[Axis, ...], programmed: bool) -> str | None:
    if ethernet.only_send:
        return "ONLYSEND is TRUE: the KRC would not read replies; expected FALSE"
    kinds = {axis.name[0] for axis in axes}
    held = [tags for kind, tags in _POSITIONS.items() if kind in kinds]
    wanted = ["Delay", *(tag for tags in held for tag in (tags if programmed else tags[:1]))]
    missing = [f"DEF_{tag}" for tag in wanted if tag not in ethernet.sent]
    if not missing:
        return None
    option = ""
    if all(tag[5] == "S" for tag in missing):  # DEF_ASPos, DEF_ESPos
        option = ", or in the cell link.reference: measured (corrections count from the measured position)"
    return f"SEND lacks {', '.join(missing)}; expected them in it{option}"


def _received_objection(ethernet: Ethernet, axes: tuple[Axis, ...], relative: bool) -> str | None:
    corrections = _corrections(ethernet)
    names = [element.attribute for element in corrections]
    for axis in axes:
        if names.count(axis.name) != 1:
            found = names.count(axis.name)
            return (
                f"RECEIVE has {found} DOUBLE elements for {axis.name} ({axis.joint}); expected one, as AK.A1"
            )
    for element in corrections:
        if element.hold is relative:
            return f"RECEIVE: {element.tag}.{element.attribute} has HOLDON {_HOLDING[relative]}"
    return None


def _length_objection(writer: ReplyWriter, axes: int) -> str | None:
    length = len(writer.write((-10000.0,) * axes, 10**19))
    if length <= LONGEST_REPLY:
        return None
    return (
        f"replies would have {length} bytes, a KRC takes {LONGEST_REPLY}; expected fewer elements in RECEIVE"
    )


_POSITIONS = {"A": ("AIPos", "ASPos"), "E": ("EIPos", "ESPos")}
_HOLDING = {
    False: '0: one lost reply would command a jump back to the programmed position; expected HOLDON="1"',
    True: '1: in relative mode a lost reply would be added again and again; expected HOLDON="0"',
}


def _reach(own: RsiLinkConfig, axes: tuple[Axis, ...]) -> Joints:
    if own.axiscorr is None:
        return (math.inf,) * len(axes)
    given = {str(name): value for name, value in own.axiscorr.items()}
    default = 5.0  # KUKA's
    return tuple(given.get(a.name, given.get(a.name[0], default)) / abs(a.sent) for a in axes)


def _corrections(ethernet: Ethernet) -> list[Received]:
    return [one for one in ethernet.received if one.attribute in AXES and one.type == "DOUBLE"]


def _unsent(ethernet: Ethernet) -> tuple[str, ...]:
    """Values that the KRC takes for zero from the beginning, and for which zero may mean something."""
    carried = _corrections(ethernet)
    others = [one for one in ethernet.received if one not in carried]
    return tuple(one.name for one in others if one.tag != "RKorr" and one.name not in ("EStr", "Stop"))


def _listen(config: "CellConfig", robot: str, own: RsiLinkConfig, ethernet: Ethernet) -> Address:
    if own.listen is None:
        if is_host(ethernet.host):
            return str(ipaddress.ip_address(ethernet.host)), ethernet.port
        key = ("robots", robot, "link", "ethernet")
        text = f"IP_NUMBER {ethernet.host!r} is no address of a PC; expected this PC's one, or link.listen"
        raise config.error(key, f"{own.ethernet}: {text}")
    host, _, port = own.listen.rpartition(":")
    return host.strip("[]"), int(port)


def _check(cell: "Cell", robot: "Robot", setup: Setup) -> None:
    key = ("robots", robot.name)
    objection = uncovered(setup, _row(robot.start))
    if objection is not None:
        raise cell.config.error((*key, "link", "axiscorr"), objection)
    coarsest = max(abs(axis.read) for axis in setup.axes) * 0.5 * 10.0**-setup.precision
    if robot.lag_window < 2.0 * robot.period:
        text = (
            f"a KRC acts on a reply one cycle later than it is sent, and telegrams jitter; "
            f"expected lag_window to be at least two cycles ({2000.0 * robot.period:g} ms)"
        )
        raise cell.config.error((*key, "lag_window"), text)
    if robot.q_tolerance < coarsest:
        text = (
            f"values with {setup.precision} decimals are rounded by up to {coarsest:.2g} rad or m; "
            f"expected q_tolerance to be no smaller than that, or a higher Precision on the KRC"
        )
        raise cell.config.error((*key, "q_tolerance"), text)
    invisible = shape_of(setup).objection(setup.axes, setup.precision)
    if invisible is not None:
        raise cell.config.error((*key, "link", "precision"), invisible)


def warnings_of(setup: Setup) -> list[str]:
    """Return what in the KRC's file works, but perhaps not as its author means it."""
    names = ", ".join(setup.unsent)
    unsent = (
        f"RECEIVE declares {names}, which armgate never sends: the KRC reads 0 (an override of 0 %, if it is "
        "connected to one); remove it from RECEIVE and from the signal flow unless 0 is meant"
    )
    address = (
        f"IP_NUMBER {setup.pc!r} in the KRC's file is no address of a PC: the KRC would send nothing here; "
        "write this PC's address there"
    )
    return [*([unsent] if setup.unsent else []), *([] if is_host(setup.pc) else [address])]


def is_host(text: str) -> bool:
    """Return True for the address of one machine: neither a placeholder, 0.0.0.0, broadcast nor multicast."""
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False
    return not (address.is_unspecified or address.is_multicast or text == "255.255.255.255")

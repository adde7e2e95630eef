"""Options of a virtual KRC, read from the texts of the command line."""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from armgate.cell.errors import ModelError
from armgate.emulator.krc.context import AXISCORR, AXISCORRMON, Context, Limits, Mode
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.process.network import Disturbance
from armgate.emulator.krc.process.udp_socket import Peer
from armgate.emulator.krc.profile import Profile, profile_named
from armgate.emulator.krc.robot.arm import Arm, arm_of_cell, arm_of_urdf, kr16
from armgate.emulator.krc.rsi.ethernet import A_AXES, E_AXES, Ethernet
from armgate.emulator.krc.rsi.ethernet_file import LIMIT, read_ethernet

DIRECTIONS = ("to-pc", "to-krc")
"""Directions of the network: telegrams, replies."""
ASPOS = ("stands", "moves")
"""Options for the programmed position while a correction is in force."""
_MS = 1e-3


@dataclass(frozen=True)
class Options:
    """All options of a virtual KRC.

    Attributes:
        profile: Profile of the controller.
        ethernet: Content of its RSI Ethernet file.
        context: Its RSI context.
        arm: Its robot.
        peer: Address of the PC.
        network: Disturbances of the network, by direction.
        seed: Seed of all random numbers.
        ipoc: First IPOC; None: a random one.
        port: Port of all runs; 0: another one for each run.
        stopped: True to wait for the command ``start``.
    """

    profile: Profile
    ethernet: Ethernet
    context: Context
    arm: Arm
    peer: Peer
    network: dict[str, Disturbance]
    seed: int
    ipoc: int | None
    port: int
    stopped: bool


def load_ethernet(path: Path) -> Ethernet:
    """Return the content of an RSI Ethernet file.

    Raises:
        KrcError: It cannot be read, or is not such a file.
    """
    try:
        with path.open("rb") as file:
            return read_ethernet(file.read(LIMIT + 1))
    except OSError as error:
        raise KrcError(f"{path}: {error.strerror}") from error
    except KrcError as error:
        raise KrcError(f"{path}: {error}") from error


def select_profile(name: str, cycle_ms: float | None, lag: str | None = None) -> Profile:
    """Return a profile, with another cycle or other lags if given.

    Raises:
        KrcError: There is no such profile, cycle or axis, or a lag is not above 0.
    """
    profile = profile_named(name)
    if cycle_ms is not None:
        profile = profile.in_cycle(cycle_ms * _MS)
    if lag is None:
        return profile
    lags = Limits.from_text(lag, profile.lag / _MS)
    return replace(profile, lags={axis: lags[axis] * _MS for axis in (*A_AXES, *E_AXES)})


def parse_context(
    mode: str, precision: int, timeout: int, axiscorr: str, axiscorrmon: str, aspos: str = "stands"
) -> Context:
    """Return the RSI context.

    Raises:
        KrcError: Mode, behaviour of ASPos or a limit is not one of the possible values.
    """
    if mode not in list(Mode):
        raise KrcError(f"mode {mode!r}; expected {' or '.join(Mode)}")
    if aspos not in ASPOS:
        raise KrcError(f"aspos {aspos!r}; expected {' or '.join(ASPOS)}")
    return Context(
        mode=Mode(mode),
        precision=precision,
        timeout=timeout,
        limits=Limits.from_text(axiscorr, AXISCORR),
        monitor=Limits.from_text(axiscorrmon, AXISCORRMON),
        aspos_moves=aspos == "moves",
    )


def load_arm(robot: str, cell: Sequence[Path], start: str | None) -> Arm:
    """Return the robot: ``kr16``, a robot of a cell, or a URDF file.

    Raises:
        KrcError: There is no such robot, or its joints are not those of a KUKA robot.
        ConfigError: The cell's files are wrong.
    """
    arm = _robot_of_cell(robot, cell) if cell else _robot_of_file(robot)
    if start is None:
        return arm
    try:
        values = [float(part) for part in start.split(",")]
    except ValueError as error:
        raise KrcError(f"start {start!r}; expected numbers, joined by commas") from error
    return arm.starting(values)


def _robot_of_file(robot: str) -> Arm:
    if robot == "kr16":
        return kr16()
    from armgate.cell.regular_file import is_file, read_file  # noqa: PLC0415
    from armgate.cell.urdf import read_urdf  # noqa: PLC0415  (numpy takes time to import)
    from armgate.cell.urdf.xml_tree import MAX_BYTES, decode  # noqa: PLC0415

    try:
        if not is_file(Path(robot)):
            raise ModelError("no such URDF file; expected kr16, a file, or a robot of --cell")
        urdf = read_urdf(decode(read_file(Path(robot), MAX_BYTES)))
    except ModelError as error:
        raise KrcError(f"robot {robot!r}: {error}") from error
    parents = {joint.parent for joint in urdf.joints}
    return arm_of_urdf(urdf, next(link for link in reversed(urdf.links) if link not in parents))


def _robot_of_cell(robot: str, cell: Sequence[Path]) -> Arm:
    from armgate.cell.cell import build_cell  # noqa: PLC0415
    from armgate.cell.config import load_config  # noqa: PLC0415
    from armgate.cell.urdf import read_urdf  # noqa: PLC0415

    try:
        found = build_cell(load_config(cell)).robot(robot)
        return arm_of_cell(found, read_urdf(found.urdf))
    except ModelError as error:
        raise KrcError(f"robot {robot!r}: {error}") from error


def parse_peer(to: str | None, ethernet: Ethernet) -> Peer:
    """Return the address of the PC, as given or from the KRC's file.

    Raises:
        KrcError: It is not an address.
    """
    if to is None:
        if not _is_host_address(ethernet.host):
            text = (
                f"IP_NUMBER {ethernet.host!r} is not the address of a PC; expected one in the file, or --to"
            )
            raise KrcError(text)
        return Peer.resolve(ethernet.host, ethernet.port)
    host, _, port = to.rpartition(":")
    host = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise KrcError(f"address {to!r}; expected HOST:PORT, e.g. 127.0.0.1:49152")
    return Peer.resolve(host, int(port))


def _is_host_address(text: str) -> bool:
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False
    return not (address.is_multicast or int(address) in (0, 0xFFFFFFFF))


def parse_network(
    *, loss: str, duplicate: str, reorder: str, delay: str, jitter: str
) -> dict[str, Disturbance]:
    """Return the disturbances of each direction.

    Raises:
        KrcError: A value is not a number in range.
    """
    texts = {"loss": loss, "duplicate": duplicate, "reorder": reorder, "delay": delay, "jitter": jitter}
    found: dict[str, dict[str, Any]] = {direction: {} for direction in DIRECTIONS}
    for name, text in texts.items():
        scale = _MS if name in ("delay", "jitter") else 1.0
        for direction, value in _by_direction(name, text).items():
            found[direction][name] = scale * value
    try:
        return {direction: Disturbance(**values) for direction, values in found.items()}
    except ValueError as error:
        raise KrcError(str(error)) from error


def _by_direction(name: str, text: str) -> dict[str, float]:
    """Read ``0.1`` (both directions), ``to-pc=0.1`` or ``to-pc=0.1,to-krc=0.2``."""
    values: dict[str, float] = {}
    for part in text.split(","):
        direction, equals, number = part.strip().rpartition("=")
        try:
            given = dict.fromkeys([direction] if equals else DIRECTIONS, float(number))
        except ValueError:
            given = {"": 0.0}
        if not set(given) <= set(DIRECTIONS) or not values.keys().isdisjoint(given):
            raise KrcError(
                f"{name} {text!r}; expected one number, such as 0.5, or to-pc=NUMBER,to-krc=NUMBER"
            )
        values |= given
    return values

"""From the command line's texts to a virtual KRC."""

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from armgate.cell.errors import ModelError
from armgate.emulator.krc.arm import Arm, arm_of_cell, arm_of_urdf, kr16
from armgate.emulator.krc.context import AXISCORR, AXISCORRMON, Context, Limits, Mode
from armgate.emulator.krc.errors import KrcError
from armgate.emulator.krc.ethernet import A_AXES, E_AXES, LIMIT, Ethernet, read_ethernet
from armgate.emulator.krc.network import Disturbance
from armgate.emulator.krc.port import Peer
from armgate.emulator.krc.profile import Profile, profile_named

DIRECTIONS = ("to-pc", "to-krc")
"""As the KRC sees them: telegrams, replies."""
ASPOS = ("stands", "moves")
"""Behaviour of the programmed position under correction."""
_MS = 1e-3


@dataclass(frozen=True)
class Setup:
    """All that a virtual KRC is started with.

    Attributes:
        profile: Which controller.
        ethernet: Its file.
        context: Its RSI context.
        arm: Its robot.
        peer: Where the PC is.
        network: What happens to datagrams, by direction.
        seed: Of all that happens by chance.
        ipoc: The first one; None: any.
        port: From which each run sends; 0: from another one each.
        stopped: Whether it waits for ``start``.
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


def ethernet_of(path: Path) -> Ethernet:
    """The KRC's file.

    Raises:
        KrcError: It cannot be read, or is no such file.
    """
    try:
        with path.open("rb") as file:
            return read_ethernet(file.read(LIMIT + 1))
    except OSError as error:
        raise KrcError(f"{path}: {error.strerror}") from error
    except KrcError as error:
        raise KrcError(f"{path}: {error}") from error


def profile_of(name: str, cycle_ms: float | None, lag: str | None = None) -> Profile:
    """Return the profile with another cycle or other lags, if given.

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


def context_of(
    mode: str, precision: int, timeout: int, axiscorr: str, axiscorrmon: str, aspos: str = "stands"
) -> Context:
    """The RSI context.

    Raises:
        KrcError: Mode, behaviour of ASPos or a limit is none of those expected.
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


def arm_of(robot: str, cell: Sequence[Path], start: str | None) -> Arm:
    """The robot: ``kr16``, one of a cell, or a URDF file.

    Raises:
        KrcError: There is none, or it is no KUKA's.
        ConfigError: The cell's files are wrong.
    """
    arm = _named_arm(robot, cell)
    if start is None:
        return arm
    try:
        values = [float(part) for part in start.split(",")]
    except ValueError as error:
        raise KrcError(f"start {start!r}; expected numbers, joined by commas") from error
    return arm.starting(values)


def _named_arm(robot: str, cell: Sequence[Path]) -> Arm:
    if not cell and robot == "kr16":
        return kr16()
    from armgate.cell.plain_file import is_file, read_file  # noqa: PLC0415
    from armgate.cell.urdf import read_urdf  # noqa: PLC0415 (what it needs takes time)
    from armgate.cell.urdf_xml import MAX_BYTES, decoded  # noqa: PLC0415

    try:
        if not cell:
            if not is_file(Path(robot)):
                raise ModelError("no such URDF file; expected kr16, a file, or a robot of --cell")
            urdf = read_urdf(decoded(read_file(Path(robot), MAX_BYTES)))
            children = {joint.parent for joint in urdf.joints}
            return arm_of_urdf(urdf, next(link for link in reversed(urdf.links) if link not in children))
        from armgate.cell.cell import build_cell  # noqa: PLC0415
        from armgate.cell.config import load_config  # noqa: PLC0415

        found = build_cell(load_config(cell)).robot(robot)
        return arm_of_cell(found, read_urdf(found.urdf))
    except ModelError as error:
        raise KrcError(f"robot {robot!r}: {error}") from error


def peer_of(to: str | None, ethernet: Ethernet) -> Peer:
    """The PC's address: as given, else as the KRC's file says.

    Raises:
        KrcError: It is none.
    """
    if to is None:
        if not _of_one_machine(ethernet.host):
            text = f"IP_NUMBER {ethernet.host!r} is no address of a PC; expected one in the file, or --to"
            raise KrcError(text)
        return Peer.resolve(ethernet.host, ethernet.port)
    host, _, port = to.rpartition(":")
    host = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise KrcError(f"address {to!r}; expected HOST:PORT, e.g. 127.0.0.1:49152")
    return Peer.resolve(host, int(port))


def _of_one_machine(text: str) -> bool:
    try:
        address = ipaddress.ip_address(text)
    except ValueError:
        return False
    return not (address.is_multicast or int(address) in (0, 0xFFFFFFFF))


def network_of(*, loss: str, duplicate: str, reorder: str, delay: str, jitter: str) -> dict[str, Disturbance]:
    """What happens to datagrams in each direction.

    Raises:
        KrcError: A value is none.
    """
    texts = {"loss": loss, "duplicate": duplicate, "reorder": reorder, "delay": delay, "jitter": jitter}
    found: dict[str, dict[str, Any]] = {direction: {} for direction in DIRECTIONS}
    for name, text in texts.items():
        scale = _MS if name in ("delay", "jitter") else 1.0
        for direction, value in _both(name, text).items():
            found[direction][name] = scale * value
    try:
        return {direction: Disturbance(**values) for direction, values in found.items()}
    except ValueError as error:
        raise KrcError(str(error)) from error


def _both(name: str, text: str) -> dict[str, float]:
    """``0.1`` for both directions, ``to-pc=0.1`` or ``to-pc=0.1,to-krc=0.2``."""
    values: dict[str, float] = {}
    for part in text.split(","):
        direction, equals, number = part.strip().rpartition("=")
        try:
            meant = dict.fromkeys([direction] if equals else DIRECTIONS, float(number))
        except ValueError:
            meant = {"": 0.0}
        if not set(meant) <= set(DIRECTIONS) or not values.keys().isdisjoint(meant):
            raise KrcError(f"{name} {text!r}; expected one number, as 0.5, or to-pc=NUMBER,to-krc=NUMBER")
        values |= meant
    return values

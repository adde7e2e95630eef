"""Configuration of an RSI link."""

import ipaddress
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field

from armgate.cell.config.fields import Angle, ConfigModel, Factor, Length, Name, Period
from armgate.cell.config.link import LinkConfig


def _address(text: str) -> str:
    try:
        return str(ipaddress.ip_address(text))
    except ValueError:
        raise ValueError(f"{text!r} is not an IP address; expected one like 192.168.1.20") from None


def _endpoint(text: str) -> str:
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise ValueError(f"{text!r}; expected ADDRESS:PORT, e.g. 192.168.1.10:49152")
    _address(host.strip("[]"))
    return text


AxisName = Literal["A1", "A2", "A3", "A4", "A5", "A6", "E1", "E2", "E3", "E4", "E5", "E6"]
AxisGroup = AxisName | Literal["A", "E"]
_Positive = Annotated[float, Field(gt=0.0)]


class RsiAxisConfig(ConfigModel):
    """Assignment of a joint to an axis of the KRC, and the units of its values."""

    joint: Name
    """Name of the joint."""
    received: Factor = 1.0
    """Value that the KRC sends for 1 deg or 1 mm of the joint; negative if the axis turns the other way."""
    sent: Factor = 1.0
    """Value that the KRC expects for 1 deg or 1 mm of the joint; negative if the axis turns the other way."""


class RsiLinkConfig(LinkConfig):
    """Link to a KUKA robot by RSI; the robot's ``period`` is the KRC's cycle."""

    UNHASHED: ClassVar[frozenset[str]] = frozenset({"ethernet", "krc", "listen"})

    kind: Literal["rsi"]
    """Kind of the link."""
    ethernet: str
    """RSI Ethernet file of the KRC, relative to the file that contains the key."""
    krc: Annotated[str, AfterValidator(_address)]
    """IP address from which the KRC's telegrams come."""
    listen: Annotated[str, AfterValidator(_endpoint)] | None = None
    """ADDRESS:PORT to listen on; absent: as in the KRC's file."""
    mode: Literal["absolute", "relative"] = "absolute"
    """Mode of RSI_ON: a value is the whole offset (``absolute``) or is added in each cycle (``relative``)."""
    reference: Literal["programmed", "measured"] = "programmed"
    """Position to which corrections are added: ``programmed`` (ASPos) or ``measured``.

    ``measured`` is AIPos of the resting robot when the KRC's program begins; use it if ASPos is not sent."""
    axes: dict[AxisName, RsiAxisConfig] = {}
    """Axes that differ from the usual assignment: prismatic joints are E1…, the others A1…, in order."""
    precision: Annotated[int, Field(ge=0, le=9)] = 6
    """Number of decimals in telegrams."""
    timeout: Annotated[int, Field(ge=1)] = 10
    """Timeout of the KRC's Ethernet object: the Delay at which the link becomes faulted [cycles]."""
    late_in_a_row: Annotated[int, Field(ge=1)] = 5
    """Number of consecutive late cycles at which the link becomes faulted."""
    silence: Period = 0.1
    """Time without a telegram after which the link is lost [s]."""
    axiscorr: dict[AxisGroup, _Positive] | None = None
    """Largest correction of each axis, as in AXISCORR [deg or mm]; ``A`` and ``E`` stand for whole groups.

    Absent: unknown and not checked."""
    virtual: Literal["krc2-rsi2", "krc4-rsi3", "krc5-rsi5"] | None = None
    """Profile of the virtual KRC that replaces the robot when a command also starts the robots.

    Absent: a real KRC, which no command starts."""
    angle_tolerance: Annotated[Angle, Field(gt=0.0)] = 0.0035
    """Largest deviation of a resting rotary axis from its expected position [rad]."""
    length_tolerance: Annotated[Length, Field(gt=0.0)] = 0.0002
    """Largest deviation of a resting linear axis from its expected position [m]."""

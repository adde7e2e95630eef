"""How a robot is reached: the configuration of its link."""

import ipaddress
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from armgate.cell.values import Angle, Duration, Factor, Length, Name, Part, Period


def _address(text: str) -> str:
    try:
        return str(ipaddress.ip_address(text))
    except ValueError:
        raise ValueError(f"{text!r} is no address; expected one like 192.168.1.20") from None


def _endpoint(text: str) -> str:
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise ValueError(f"{text!r}; expected ADDRESS:PORT, e.g. 192.168.1.10:49152")
    _address(host.strip("[]"))
    return text


AxisName = Literal["A1", "A2", "A3", "A4", "A5", "A6", "E1", "E2", "E3", "E4", "E5", "E6"]
AxisGroup = AxisName | Literal["A", "E"]
_Positive = Annotated[float, Field(gt=0.0)]


class EmulatedLinkConfig(Part):
    """An emulated robot that follows its setpoint with a first-order lag.

    Attributes:
        lag: Time constant, s; 0: the robot follows at once.
        lags: Time constants of joints that lag differently, by joint name, s.
    """

    kind: Literal["emulated"] = "emulated"
    lag: Annotated[Duration, Field(ge=0.0)] = 0.03
    lags: dict[Name, Annotated[Duration, Field(ge=0.0)]] = {}


class RsiAxisConfig(Part):
    """Which joint an axis of the KRC is, and in what units its values come and go.

    Attributes:
        joint: Name of the joint.
        received: What the KRC calls 1 deg or 1 mm of the joint; negative where the axis turns the other way.
        sent: The same for what goes to the KRC.
    """

    joint: Name
    received: Factor = 1.0
    sent: Factor = 1.0


class RsiLinkConfig(Part):
    """A KUKA robot by RSI; its ``period`` is the KRC's cycle.

    Attributes:
        ethernet: The KRC's own RSI Ethernet file; a relative path counts from the file in which it stands.
        krc: Address from which its telegrams come.
        listen: ADDRESS:PORT to listen on; None: as the KRC's file says.
        mode: As in RSI_ON: a value is the whole offset, or is added in every cycle.
        reference: Position from which corrections count: ``programmed`` (ASPos), or, if the KRC does not send
            it, ``measured`` (AIPos of the resting robot when the KRC's program begins).
        axes: Axes that are not as usual: prismatic joints are E1…, the others A1…, one by one.
        precision: Decimals of the values in telegrams.
        timeout: The Timeout of the KRC's Ethernet object: at this Delay the link gives up.
        late_in_a_row: At so many late cycles in a row the link gives up.
        silence: After how long without a telegram the link is lost, s.
        axiscorr: Largest correction of each axis as AXISCORR has it, deg and mm, ``A`` and ``E`` for all of
            them; None: not known, not checked.
        lag: Time constant with which the measured position follows, s: what controllers may reckon with.
        virtual: Profile of the virtual KRC that stands in for it where a command starts the robots, too;
            None: it is a real one, which nobody starts.
        angle_tolerance: How far a resting axis may be from where it should be, rad.
        length_tolerance: The same for prismatic joints, m.
    """

    kind: Literal["rsi"]
    ethernet: str
    krc: Annotated[str, AfterValidator(_address)]
    listen: Annotated[str, AfterValidator(_endpoint)] | None = None
    mode: Literal["absolute", "relative"] = "absolute"
    reference: Literal["programmed", "measured"] = "programmed"
    axes: dict[AxisName, RsiAxisConfig] = {}
    precision: Annotated[int, Field(ge=0, le=9)] = 6
    timeout: Annotated[int, Field(ge=1)] = 10
    late_in_a_row: Annotated[int, Field(ge=1)] = 5
    silence: Period = 0.1
    axiscorr: dict[AxisGroup, _Positive] | None = None
    lag: Annotated[Duration, Field(ge=0.0)] = 0.03
    virtual: Literal["krc2-rsi2", "krc4-rsi3", "krc5-rsi5"] | None = None
    angle_tolerance: Annotated[Angle, Field(gt=0.0)] = 0.0035
    length_tolerance: Annotated[Length, Field(gt=0.0)] = 0.0002


LinkConfig = EmulatedLinkConfig | RsiLinkConfig

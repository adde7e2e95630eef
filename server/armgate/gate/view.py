"""What the gate tells of a robot, for the state."""

from dataclasses import dataclass

from armgate.events import Joints, LinkState, Nearest, Verdict
from armgate.gate.robot import RobotState


@dataclass(frozen=True, slots=True)
class RobotView:
    """What the state tells of one robot."""

    tick: int
    time: float
    q: Joints
    setpoint: Joints
    stop_end: Joints
    nearest: tuple[Nearest, ...]
    least_clearance: float | None
    applied_seq: int | None
    stops: tuple[int, ...]
    link: LinkState
    late: int
    verdict: Verdict | None
    counts: dict[str, int]


def view_of(s: RobotState) -> RobotView:
    """Returns what the state tells of a robot; empty positions while its clock has not spoken."""
    furthest = s.next or s.main
    return RobotView(
        tick=max(s.tick, 0),
        time=s.time,
        q=s.measured,
        setpoint=s.setpoint,
        stop_end=furthest.occupied.end if furthest else (),
        nearest=s.nearest,
        least_clearance=s.least,
        applied_seq=s.applied_seq,
        stops=tuple(s.stops),
        link=s.link,
        late=s.late,
        verdict=s.verdict,
        counts=dict(s.counts),
    )

"""From what the gate says to what stands on the wire."""

import math

from armgate.cell import events
from armgate.integrity import RobotView
from armgate.protocol import messages as m

_TEXT = 512
_NEAREST = 16


def verdict(given: events.Verdict) -> m.Verdict:
    """A verdict for the one who sent the command."""
    return m.Verdict(
        robot=given.robot,
        seq=given.seq,
        tick=given.based_on,
        target=given.target,
        outcome=given.outcome.value,
        beta=given.beta,
        dq=given.dq,
        setpoint=given.setpoint,
        reasons=tuple(_reason(reason) for reason in given.reasons),
    )


def entry(robot: str, view: RobotView, holder: str | None) -> m.Entry:
    """All that the state tells of one robot."""
    return m.Entry(
        robot=robot,
        tick=view.tick,
        time=view.time,
        q=view.q,
        setpoint=view.setpoint,
        applied_seq=view.applied_seq,
        stop_end=view.stop_end,
        nearest=tuple(_nearest(nearest) for nearest in view.nearest[:_NEAREST]),
        least_clearance=_finite(view.least_clearance),
        holder=holder,
        stops=view.stops,
        link=view.link.value,
        verdict=None if view.verdict is None else _last(view.verdict),
        counts=dict(view.counts),
        late_commands=view.late,
    )


def text(given: str) -> str:
    """``given``, cut to what a message may hold."""
    return given if len(given) <= _TEXT else given[: _TEXT - 1] + "…"


def _last(given: events.Verdict) -> m.LastVerdict:
    if not given.reasons:
        return m.LastVerdict(seq=given.seq, outcome=given.outcome.value)
    first = given.reasons[0]
    return m.LastVerdict(
        seq=given.seq, outcome=given.outcome.value, cause=first.cause.value, text=text(first.text)
    )


def _reason(reason: events.Reason) -> m.Reason:
    return m.Reason(
        cause=reason.cause.value,
        text=text(reason.text),
        joint=reason.joint,
        pair=reason.pair,
        value=_finite(reason.value),
        bound=_finite(reason.bound),
        points=reason.points,
    )


def _nearest(nearest: events.Nearest) -> m.Nearest:
    return m.Nearest(pair=nearest.pair, distance=nearest.distance, limit=nearest.limit, points=nearest.points)


def _finite(value: float | None) -> float | None:
    """A command may have asked for NaN; the wire tells numbers only."""
    return value if value is not None and math.isfinite(value) else None

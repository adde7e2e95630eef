"""Translation of the results of gate and daemon into messages of the protocol, within the protocol's bounds.

Texts, and the lists of verdicts and states, may be longer than a message allows. They are shortened here and
nowhere else: ``text``, ``reasons``, ``stops``, ``warnings``, ``entry``. The last reason or warning that is
kept gives the number of those left out.
"""

import math
from collections.abc import Iterable, Sequence
from typing import TypeVar

from armgate import events
from armgate.gate import RobotView
from armgate.protocol import messages as m
from armgate.protocol.unvalidated import unvalidated

A = TypeVar("A", bound=m.Answer)

_WITHOUT_REASON = {"seq", "outcome"}
"""Fields of a last verdict without reasons that count as set."""


def answer(model: type[A], request: m.Request | None, **fields: object) -> A:
    """Return an answer to ``request``, or an unsolicited message for None.

    ``re`` is set only if the request has an id to repeat.
    """
    if request is not None and request.id is not None:
        fields["re"] = request.id
    return model.model_validate(fields)


def signaled(request: m.Signal) -> m.Signaled:
    """Return the answer to a signal: that of `answer`, for a message that is sent many times per step."""
    fields = {"type": "signaled", "re": request.id, "name": request.name}
    return unvalidated(m.Signaled, fields, {"name"} if request.id is None else None)


def verdict(given: events.Verdict) -> m.Verdict:
    """Return a verdict as its sender receives it."""
    fields = {
        "type": "verdict",
        "robot": given.robot,
        "seq": given.seq,
        "tick": given.based_on,
        "target": given.target,
        "outcome": str(given.outcome),
        "beta": given.beta,
        "dq": given.dq,
        "setpoint": given.setpoint,
        "reasons": reasons(given.reasons),
    }
    return unvalidated(m.Verdict, fields)


def entry(robot: str, view: RobotView, holder: str | None) -> m.Entry:
    """Return the entry of one robot in a state."""
    fields = {
        "robot": robot,
        "tick": view.tick,
        "time": view.time,
        "q": view.q,
        "setpoint": view.setpoint,
        "applied_seq": view.applied_seq,
        "stop_end": view.stop_end,
        "nearest": tuple([_nearest(nearest) for nearest in view.nearest[: m.MAX_NEAREST]]),
        "least_clearance": _finite(view.least_clearance),
        "holder": holder,
        "stops": stops(view.stops),
        "link": str(view.link),
        "verdict": None if view.verdict is None else _last(view.verdict),
        "counts": dict(view.counts),
        "late_commands": view.late,
    }
    return unvalidated(m.Entry, fields)


def text(given: str, end: str = "") -> str:
    """Return ``given`` and ``end``, with ``given`` shortened so that both fit in a message."""
    room = m.MAX_TEXT - len(end)
    return (given if len(given) <= room else given[: room - 1] + "…") + end


def reasons(given: Sequence[events.Reason]) -> tuple[m.Reason, ...]:
    """Return as many reasons as a verdict may hold: the first of each cause, the last one, then others.

    The text of the last reason gives the number of reasons left out.
    """
    if len(given) <= m.MAX_REASONS:
        return tuple([_reason(reason) for reason in given])
    firsts = {reason.cause: index for index, reason in reversed(tuple(enumerate(given)))}
    chosen = {*firsts.values(), len(given) - 1}
    others = (index for index in range(len(given)) if index not in chosen)
    chosen.update(next(others) for _ in range(m.MAX_REASONS - len(chosen)))
    kept = [_reason(given[index]) for index in sorted(chosen)]
    end = f" (and {len(given) - len(kept)} more reasons)"
    return (*kept[:-1], kept[-1].model_copy(update={"text": text(given[-1].text, end)}))


def stops(given: Sequence[int]) -> tuple[int, ...]:
    """Return the ids of the newest stops, as many as an entry may hold."""
    return tuple(given[-m.MAX_STOPS :])


def warnings(given: Iterable[str]) -> tuple[str, ...]:
    """Return as many warnings as a state may hold; the last one gives the number of those left out."""
    all_ = tuple(given)
    kept = [text(warning) for warning in all_[: m.MAX_WARNINGS]]
    if len(all_) > len(kept):
        kept[-1] = text(all_[len(kept) - 1], f" (and {len(all_) - len(kept)} more warnings)")
    return tuple(kept)


def _last(given: events.Verdict) -> m.LastVerdict:
    fields = {"seq": given.seq, "outcome": str(given.outcome), "cause": None, "text": ""}
    if not given.reasons:
        return unvalidated(m.LastVerdict, fields, _WITHOUT_REASON)
    first = given.reasons[0]
    return unvalidated(m.LastVerdict, fields | {"cause": str(first.cause), "text": text(first.text)})


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
    fields = {
        "pair": nearest.pair,
        "distance": nearest.distance,
        "limit": nearest.limit,
        "points": nearest.points,
    }
    return unvalidated(m.Nearest, fields)


def _finite(value: float | None) -> float | None:
    """Return None for NaN and infinity: a command may contain them, a message may not."""
    return value if value is not None and math.isfinite(value) else None

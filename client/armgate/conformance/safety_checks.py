"""Checks of the motion of robots, only from the states that the kit's observer received.

The checks are pure functions of samples. They compare the server's verdicts with the motion that follows.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from armgate.conformance.codec import Fields
from armgate.conformance.command_log import CommandLog

_SAME = 1e-9
"""Tolerance for rounding, rad or m."""

_NEAR = 1e-6
"""Tolerance of a reported distance below its limit, m."""


@dataclass(frozen=True, slots=True)
class JointBounds:
    """Bounds of the joints of one robot, from its description.

    Attributes:
        lower: Lower limits, rad or m.
        upper: Upper limits.
        step: Largest increment of one tick.
        change: Largest growth of an increment from tick to tick.
        brake: Largest decrease of an increment; infinite if a joint may stop at once.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    step: tuple[float, ...]
    change: tuple[float, ...]
    brake: tuple[float, ...]

    @classmethod
    def of(cls, robot: Fields) -> "JointBounds":
        """Return the bounds of a robot of the description."""
        period, joints = robot["period"], robot["joints"]
        return cls(
            tuple(joint["lower"] for joint in joints),
            tuple(joint["upper"] for joint in joints),
            tuple(joint["velocity"] * period for joint in joints),
            tuple(joint["acceleration"] * period**2 for joint in joints),
            tuple((joint["deceleration"] or math.inf) * period**2 for joint in joints),
        )


@dataclass(frozen=True, slots=True)
class Sample:
    """One robot at one of its ticks, from a state."""

    tick: int
    setpoint: tuple[float, ...]
    applied: int | None
    holder: str | None
    stops: tuple[int, ...]
    nearest: tuple[tuple[tuple[str, str], float, float], ...] = ()

    @classmethod
    def of(cls, entry: Fields) -> "Sample":
        """Return the sample of an entry with all fields."""
        nearest = entry.get("nearest") or ()
        return cls(
            entry["tick"],
            tuple(entry["setpoint"] or ()),
            entry["applied_seq"],
            entry["holder"],
            tuple(entry["stops"] or ()),
            tuple(((n["pair"][0], n["pair"][1]), n["distance"], n["limit"]) for n in nearest),
        )


def unsafe_motion(
    robot: str, samples: Sequence[Sample], bounds: JointBounds, commands: CommandLog
) -> Iterator[str]:
    """Yield the motions of a robot that must not happen, over the states of one case."""
    yield from _limits(robot, samples, bounds)
    yield from _steps(robot, samples, bounds)
    yield from _uncommanded(robot, samples)
    yield from _changes(robot, samples, bounds)
    yield from _applied(robot, samples, commands)
    yield from _clearances(robot, samples)


def is_at_rest(samples: Sequence[Sample]) -> bool:
    """Return True if the last two states have the same setpoint."""
    return len(samples) > 1 and _moved(samples[-2], samples[-1]) == (0.0,) * len(samples[-1].setpoint)


def _moved(before: Sample, after: Sample) -> tuple[float, ...]:
    return tuple(b - a for a, b in zip(before.setpoint, after.setpoint, strict=True))


def _limits(robot: str, samples: Sequence[Sample], bounds: JointBounds) -> Iterator[str]:
    for before, after in pairwise(samples):
        for j, (was, now) in enumerate(zip(before.setpoint, after.setpoint, strict=True)):
            beyond = max(bounds.lower[j] - now, now - bounds.upper[j])
            if beyond > _SAME and beyond > max(bounds.lower[j] - was, was - bounds.upper[j]) + _SAME:
                yield f"{robot}: at tick {after.tick} joint {j} is commanded {beyond:.6f} beyond its limits"


def _steps(robot: str, samples: Sequence[Sample], bounds: JointBounds) -> Iterator[str]:
    for before, after in pairwise(samples):
        for j, step in enumerate(_moved(before, after)):
            bound = bounds.step[j] * max(after.tick - before.tick, 1)
            if abs(step) > bound * (1 + _SAME) + _SAME:
                yield (
                    f"{robot}: from tick {before.tick} to {after.tick} joint {j} moves by {step:.6f}; "
                    f"its speed allows {bound:.6f}"
                )


# The increments u (at a tick) and u′ (at the next) of a joint obey, with the acceleration a and deceleration
# d per tick² (CMD-37): |u′| − |u| ≤ a and |u| − |u′| ≤ d if the sign stays, and |u|/d + |u′|/a ≤ 1 if it
# changes. Without a newly applied command a robot brakes, so |u′| ≤ |u| and the sign stays.


def _uncommanded(robot: str, samples: Sequence[Sample]) -> Iterator[str]:
    """Yield joints that speed up without a newly applied command: a robot must brake then."""
    for b, c, j, before, now in _increments(samples):
        gain = now - before if before >= 0 else before - now
        reversal = abs(now) if now * before < 0 else 0.0
        if b.applied == c.applied and (gain > _SAME or reversal > _SAME):
            why = ", while stopped" if b.stops else ", while no client holds it" if b.holder is None else ""
            yield (
                f"{robot}: at tick {c.tick} joint {j} speeds up from {before:.6f} to {now:.6f} per tick, "
                f"although no new command is applied{why}"
            )


def _changes(robot: str, samples: Sequence[Sample], bounds: JointBounds) -> Iterator[str]:
    """Yield joints whose increment grows, shrinks or changes sign faster than their bounds allow."""
    for b, c, j, before, now in _increments(samples):
        if set(b.stops) - set(c.stops):
            continue  # a reset: the setpoint becomes the measured position
        gain, loss = max(abs(now) - _SAME, 0.0), max(abs(before) - _SAME, 0.0)
        if now * before >= 0:
            gain, loss = max(abs(now) - abs(before) - _SAME, 0.0), max(abs(before) - abs(now) - _SAME, 0.0)
        if gain / bounds.change[j] + loss / bounds.brake[j] > 1 + 1e-6:
            how = "turns" if gain and loss else "accelerates" if gain else "brakes"
            yield (
                f"{robot}: at tick {c.tick} joint {j} {how} from {before:.6f} to {now:.6f} per tick, "
                "faster than its bounds allow"
            )


def _increments(samples: Sequence[Sample]) -> Iterator[tuple[Sample, Sample, int, float, float]]:
    """Yield each joint's increments at two ticks in a row: both samples, the joint, both increments."""
    for a, b, c in zip(samples, samples[1:], samples[2:], strict=False):
        if (a.tick + 1, b.tick + 1) == (b.tick, c.tick):  # else the states between are unknown
            for j, (before, now) in enumerate(zip(_moved(a, b), _moved(b, c), strict=True)):
                yield b, c, j, before, now


def _applied(robot: str, samples: Sequence[Sample], commands: CommandLog) -> Iterator[str]:
    for before, after in pairwise(samples):
        if after.applied == before.applied or after.applied is None:
            continue
        seq = after.applied
        verdict = commands.verdicts.get((robot, seq))
        if (robot, seq) not in commands.sent:
            yield f"{robot}: at tick {after.tick} seq {seq} is applied, which no client sent"
        elif why := commands.forbidden.get((robot, seq)):
            yield f"{robot}: at tick {after.tick} seq {seq} is applied, which is forbidden: {why}"
        elif verdict is not None:
            yield from _against_verdict(robot, after, verdict)
        if before.stops and before.stops == after.stops:
            yield f"{robot}: at tick {after.tick} seq {seq} is applied, although the robot is stopped"


def _against_verdict(robot: str, after: Sample, verdict: Fields) -> Iterator[str]:
    seq = verdict["seq"]
    if verdict["outcome"] == "refused":
        yield f"{robot}: at tick {after.tick} seq {seq} is applied, which was refused"
    elif verdict["target"] is not None and verdict["target"] > after.tick:
        yield f"{robot}: seq {seq} is applied at tick {after.tick}; its verdict names {verdict['target']}"
    elif verdict["target"] == after.tick:
        off = max(abs(a - b) for a, b in zip(after.setpoint, verdict["setpoint"], strict=True))
        if off > _SAME:
            text = f"the setpoint is {off:.6f} off that of the verdict of seq {seq}"
            yield f"{robot}: at tick {after.tick} {text}"


def _clearances(robot: str, samples: Sequence[Sample]) -> Iterator[str]:
    if not samples:
        return
    violated = {pair for pair, distance, limit in samples[0].nearest if distance < limit}
    for sample in samples[1:]:
        for pair, distance, limit in sample.nearest:
            if pair not in violated and distance < limit - _NEAR:
                yield (
                    f"{robot}: at tick {sample.tick} {pair[0]} and {pair[1]} are {distance:.6f} m apart; "
                    f"the limit is {limit} m"
                )
                return

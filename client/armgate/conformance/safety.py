"""Did a robot do what it must not? Judged from the states that the kit's own observer saw, nothing else.

Pure: samples in, findings out. What the server says in verdicts is held against what the robots did.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from armgate.conformance.ledger import Ledger
from armgate.conformance.packing import Fields

_SAME = 1e-9
"""Rounding, rad or m."""

_NEAR = 1e-6
"""How far a told distance may be below its limit, m."""


@dataclass(frozen=True, slots=True)
class Joints:
    """The bounds of one robot's joints, from its description.

    Attributes:
        lower: Lower limits, rad or m.
        upper: Upper limits.
        step: The largest increment in one tick.
        change: By how much an increment may be larger than the one before.
        brake: By how much it may be smaller; infinite where a joint may stop at once.
    """

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    step: tuple[float, ...]
    change: tuple[float, ...]
    brake: tuple[float, ...]

    @classmethod
    def of(cls, robot: Fields) -> "Joints":
        """Those of a robot of the description."""
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
    """One robot at one of its ticks, as a state told it."""

    tick: int
    setpoint: tuple[float, ...]
    applied: int | None
    holder: str | None
    stops: tuple[int, ...]
    nearest: tuple[tuple[tuple[str, str], float, float], ...] = ()

    @classmethod
    def of(cls, entry: Fields) -> "Sample":
        """That of an entry with all fields."""
        nearest = entry.get("nearest") or ()
        return cls(
            entry["tick"],
            tuple(entry["setpoint"] or ()),
            entry["applied_seq"],
            entry["holder"],
            tuple(entry["stops"] or ()),
            tuple(((n["pair"][0], n["pair"][1]), n["distance"], n["limit"]) for n in nearest),
        )


def judge(robot: str, samples: Sequence[Sample], joints: Joints, ledger: Ledger) -> Iterator[str]:
    """What a robot did that it must not have done, over the states of one case."""
    yield from _limits(robot, samples, joints)
    yield from _steps(robot, samples, joints)
    yield from _uncommanded(robot, samples)
    yield from _changes(robot, samples, joints)
    yield from _applied(robot, samples, ledger)
    yield from _clearances(robot, samples)


def at_rest(samples: Sequence[Sample]) -> bool:
    """Whether the last two states show the same setpoint."""
    return len(samples) > 1 and _moved(samples[-2], samples[-1]) == (0.0,) * len(samples[-1].setpoint)


def _moved(before: Sample, after: Sample) -> tuple[float, ...]:
    return tuple(b - a for a, b in zip(before.setpoint, after.setpoint, strict=True))


def _limits(robot: str, samples: Sequence[Sample], joints: Joints) -> Iterator[str]:
    for before, after in pairwise(samples):
        for j, (was, now) in enumerate(zip(before.setpoint, after.setpoint, strict=True)):
            beyond = max(joints.lower[j] - now, now - joints.upper[j])
            if beyond > _SAME and beyond > max(joints.lower[j] - was, was - joints.upper[j]) + _SAME:
                yield f"{robot}: at tick {after.tick} joint {j} is commanded {beyond:.6f} beyond its limits"


def _steps(robot: str, samples: Sequence[Sample], joints: Joints) -> Iterator[str]:
    for before, after in pairwise(samples):
        for j, step in enumerate(_moved(before, after)):
            bound = joints.step[j] * max(after.tick - before.tick, 1)
            if abs(step) > bound * (1 + _SAME) + _SAME:
                yield (
                    f"{robot}: from tick {before.tick} to {after.tick} joint {j} is moved by {step:.6f}; "
                    f"its speed allows {bound:.6f}"
                )


def _uncommanded(robot: str, samples: Sequence[Sample]) -> Iterator[str]:
    """Between the commands that are applied a robot brakes."""
    for b, c, j, before, now in _increments(samples):
        gain = now - before if before >= 0 else before - now
        reversal = abs(now) if now * before < 0 else 0.0
        if b.applied == c.applied and (gain > _SAME or reversal > _SAME):
            why = ", while stopped" if b.stops else ", while nobody holds it" if b.holder is None else ""
            yield (
                f"{robot}: at tick {c.tick} joint {j} speeds up from {before:.6f} to {now:.6f} a tick "
                f"without a command applied{why}"
            )


def _changes(robot: str, samples: Sequence[Sample], joints: Joints) -> Iterator[str]:
    """No increment grows, shrinks or turns faster than the joint's bounds allow."""
    for b, c, j, before, now in _increments(samples):
        if set(b.stops) - set(c.stops):
            continue  # a reset: the setpoint is where the robot was measured
        gain, loss = max(abs(now) - _SAME, 0.0), max(abs(before) - _SAME, 0.0)
        if now * before >= 0:
            gain, loss = max(abs(now) - abs(before) - _SAME, 0.0), max(abs(before) - abs(now) - _SAME, 0.0)
        if gain / joints.change[j] + loss / joints.brake[j] > 1 + 1e-6:
            how = "turns" if gain and loss else "accelerates" if gain else "brakes"
            yield (
                f"{robot}: at tick {c.tick} joint {j} {how} from {before:.6f} to {now:.6f} a tick, "
                "faster than its bounds allow"
            )


def _increments(samples: Sequence[Sample]) -> Iterator[tuple[Sample, Sample, int, float, float]]:
    """Each joint's increment at a tick and at the next: both samples, the joint, both increments."""
    for a, b, c in zip(samples, samples[1:], samples[2:], strict=False):
        if (a.tick + 1, b.tick + 1) == (b.tick, c.tick):  # else nothing is known of what was between
            for j, (before, now) in enumerate(zip(_moved(a, b), _moved(b, c), strict=True)):
                yield b, c, j, before, now


def _applied(robot: str, samples: Sequence[Sample], ledger: Ledger) -> Iterator[str]:
    for before, after in pairwise(samples):
        if after.applied == before.applied or after.applied is None:
            continue
        seq = after.applied
        verdict = ledger.verdicts.get((robot, seq))
        if (robot, seq) not in ledger.sent:
            yield f"{robot}: at tick {after.tick} seq {seq} is applied, which nobody sent"
        elif why := ledger.forbidden.get((robot, seq)):
            yield f"{robot}: at tick {after.tick} seq {seq} is applied, which must not be: {why}"
        elif verdict is not None:
            yield from _as_judged(robot, before, after, verdict)
        if before.stops and before.stops == after.stops:
            yield f"{robot}: at tick {after.tick} seq {seq} is applied though it is stopped"


def _as_judged(robot: str, before: Sample, after: Sample, verdict: Fields) -> Iterator[str]:
    seq = verdict["seq"]
    if verdict["outcome"] == "refused":
        yield f"{robot}: at tick {after.tick} seq {seq} is applied, which was refused"
    elif verdict["target"] is not None and verdict["target"] > after.tick:
        yield f"{robot}: seq {seq} is applied at tick {after.tick}; its verdict names {verdict['target']}"
    elif verdict["target"] == after.tick:
        off = max(abs(a - b) for a, b in zip(after.setpoint, verdict["setpoint"], strict=True))
        if off > _SAME:
            yield f"{robot}: at tick {after.tick} the setpoint is {off:.6f} off what seq {seq}'s verdict says"


def _clearances(robot: str, samples: Sequence[Sample]) -> Iterator[str]:
    if not samples:
        return
    poor = {pair for pair, distance, limit in samples[0].nearest if distance < limit}
    for sample in samples[1:]:
        for pair, distance, limit in sample.nearest:
            if pair not in poor and distance < limit - _NEAR:
                yield (
                    f"{robot}: at tick {sample.tick} {pair[0]} and {pair[1]} are {distance:.6f} m apart; "
                    f"the limit is {limit} m"
                )
                return

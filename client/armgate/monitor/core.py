"""The second judge, pure: samples of the robots' states in, findings out. No clock, no socket, no file."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from armgate.monitor import tolerances as tol
from armgate.monitor.clearance import Clearances, Nearness, pair_names
from armgate.monitor.findings import POSITIONS, Finding
from armgate.monitor.model import Cell, Kind
from armgate.monitor.motion import Motion, Sample

_KEPT = 1000
"""Findings that are kept; the others are counted."""

_ASKED_EVERY = 8
"""Of so many states of a robot one has a reported distance recomputed."""


@dataclass(frozen=True)
class Smallest:
    """The smallest clearance of one kind of pairs: a certified lower bound, its limit, and where it was."""

    kind: Kind
    distance: float
    limit: float
    pair: tuple[str, str]
    tick: int
    time: float
    robot: str


@dataclass
class Account:
    """What was checked.

    Attributes:
        states: States of robots.
        positions: Measured positions, setpoints and ends in them.
        unseen: Robots of which no state came: nothing of them was checked.
        missed: Ticks whose states did not come, by robot.
        retreats: Margins that were violated at the start, when watching began or a robot was moved by hand.
        violations: How many findings there were.
        findings: The first of them.
        smallest: By kind of pairs.
        late: States that the live watch judged more than 0.5 s late.
        share: CPU time of the live watch by time on the wall; 0 of an audit.
    """

    states: int = 0
    positions: int = 0
    unseen: list[str] = field(default_factory=list)
    missed: dict[str, int] = field(default_factory=dict)
    retreats: int = 0
    violations: int = 0
    findings: list[Finding] = field(default_factory=list)
    smallest: dict[Kind, Smallest] = field(default_factory=dict)
    share: float = 0.0
    late: int = 0


class Monitor:
    """Judges a cell from the states of its robots.

    Args:
        cell: The cell.
        silence: A robot without a state for so long is silent, s.
        measured_every: The smallest clearances are those of every n-th tick; limits count at all.
        lockstep: True if time is virtual, so that each tick has its exact time.
    """

    def __init__(
        self, cell: Cell, silence: float = tol.SILENCE, measured_every: int = 1, *, lockstep: bool = False
    ) -> None:
        self.cell = cell
        self.account = Account(unseen=[robot.name for robot in cell.robots])
        self._silence = silence
        self._measured_every = measured_every
        self._index = {robot.name: r for r, robot in enumerate(cell.robots)}
        self._motions = [Motion(robot, lockstep) for robot in cell.robots]
        self._clearances = Clearances(cell)
        self._floors: dict[int, float] = {}
        self._seen: set[frozenset[int]] = set()
        self._silent: set[int] = set()
        self._measured: set[int] = set()
        self._open: set[tuple[str, str]] = set()
        self._stops: dict[str, frozenset[int]] = {}
        self._asked: dict[str, int] = {}
        self._ended: set[int] = set()
        self._ready: set[str] = set()
        self._bodies = {body.name: i for i, body in enumerate(cell.bodies) if not body.meshed}

    def take(self, sample: Sample, others: Iterable[Sample] = ()) -> list[Finding]:
        """Judge one robot at one of its ticks; return what is newly violated.

        Args:
            sample: The robot at its tick.
            others: Other robots as the same state shows them; each has states of its own, too.
        """
        self._reopen(sample)
        if (wrong := self._wrong_form(sample)) is not None:
            return self._report(sample, [wrong])
        robot = self._index[sample.robot]
        motion = self._motions[robot]
        self._count(motion, sample)
        self._age(sample)
        self.link(sample.robot, ended=sample.ended)
        for other in others:
            self._see(sample, other)
        poses, found = motion.take(sample)
        self._clearances.move(robot, poses)
        found += self._pairs(robot, sample, motion.moved)
        found += self._reported(sample)
        found += self._silences(sample)
        return self._report(sample, found)

    def differ(self, texts: Iterable[str]) -> list[Finding]:
        """Take over in what the described cell differs from the configuration; return the findings."""
        found = [Finding("cell", "", 0, 0.0, text) for text in texts]
        self._add(found)
        return found

    def absent(self) -> list[Finding]:
        """Take over that a recording ends; return the robots whose link was ready, but that have no state."""
        names = [name for name in self.account.unseen if name in self._ready]
        found = [Finding("silence", name, 0, 0.0, "no state, although its link was ready") for name in names]
        self._add(found)
        return found

    def link(self, robot: str, *, ended: bool) -> None:
        """Take over if the link of a robot has ended: its states may then stop."""
        if not ended:
            self._ready.add(robot)
        if (index := self._index.get(robot)) is not None:
            (self._ended.add if ended else self._ended.discard)(index)

    def silent(self, seconds: float) -> list[Finding]:
        """Take over that no state came at all for so long; return the findings, one per robot."""
        found = []
        for index, motion in enumerate(self._motions):
            last = motion.last
            if last is not None and seconds > self._silence and index not in self._silent | self._ended:
                self._silent.add(index)
                text = f"no state for {seconds:.2f} s"
                found.append(Finding("silence", last.robot, last.tick, last.time, text))
        self._add(found)
        return found

    def _age(self, sample: Sample) -> None:
        """Forget what other robots may have left: their plans, and their places after missing states."""
        for other, motion in enumerate(self._motions):
            if motion.last is None:
                continue
            age = sample.time - motion.last.time
            if age > tol.STALE * motion.robot.period:
                self._clearances.forget(other)
            elif abs(age) > tol.STEP:
                self._clearances.age_ends(other)

    def _see(self, sample: Sample, other: Sample) -> None:
        """Take over the place of another robot, unless it is too old by its own time."""
        if self._wrong_form(other) is not None:
            return
        index = self._index[other.robot]
        self.link(other.robot, ended=other.ended)
        if sample.time - other.time <= tol.STALE * self.cell.robots[index].period:
            poses = np.stack([other.q, other.setpoint, other.stop_end, other.stop_end])
            self._clearances.move(index, poses)

    # --- form and coverage --------------------------------------------------------------------------------

    def _wrong_form(self, sample: Sample) -> Finding | None:
        robot = self._index.get(sample.robot)
        n = 0 if robot is None else self.cell.robots[robot].n
        if robot is not None and all(len(x) == n for x in (sample.q, sample.setpoint, sample.stop_end)):
            return None
        text = f"a state with other joints than the configuration has ({n})"
        return Finding("form", sample.robot, sample.tick, sample.time, text)

    def _count(self, motion: Motion, sample: Sample) -> None:
        self.account.states += 1
        self.account.positions += 3
        if motion.last is None:
            self.account.unseen.remove(sample.robot)
        if motion.last is not None and sample.tick > motion.last.tick + 1:
            missed = sample.tick - motion.last.tick - 1
            self.account.missed[sample.robot] = self.account.missed.get(sample.robot, 0) + missed

    def _silences(self, sample: Sample) -> list[Finding]:
        """Return the robots whose newest state is old by the daemon's own time."""
        found = []
        for index, motion in enumerate(self._motions):
            last = motion.last
            if last is None or sample.time - last.time <= self._silence:
                self._silent.discard(index)
            elif index not in self._silent | self._ended:
                self._silent.add(index)
                text = f"no state for {sample.time - last.time:.2f} s while other robots tick"
                found.append(Finding("silence", last.robot, last.tick, last.time, text))
        return found

    # --- clearances ---------------------------------------------------------------------------------------

    def _pairs(self, robot: int, sample: Sample, moved: bool) -> list[Finding]:
        found = []
        measure = (sample.tick + robot) % self._measured_every == 0 or robot not in self._measured
        self._measured.add(robot)
        judged = {near.pair: near for near in self._clearances.check(robot, measure=measure)}
        self._note_smallest(sample)
        for pair in [pair for pair in self._floors if pair not in judged and self._concerns(pair, robot)]:
            del self._floors[pair]
        for near in judged.values():
            finding = self._judge(near, sample, moved)
            if finding is not None:
                found.append(finding)
        self._seen.add(frozenset([robot]))
        self._seen |= {
            frozenset([robot, other]) for other, m in enumerate(self._motions) if m.last is not None
        }
        return found

    def _concerns(self, pair: int, robot: int) -> bool:
        """Return True if a pair is of this robot, and the poses of both bodies are known."""
        robots = self._robots_of(pair)
        return robot in robots and all(self._clearances.sees(one) for one in robots)

    def _robots_of(self, pair: int) -> frozenset[int]:
        both = self.cell.pairs[pair]
        robots = (self.cell.bodies[both.a].robot, self.cell.bodies[both.b].robot)
        return frozenset(robot for robot in robots if robot is not None)

    def _judge(self, near: Nearness, sample: Sample, moved: bool) -> Finding | None:
        """Hold a pair that is near against its limit, or against its floor if it was violated before."""
        if near.lacking <= 0.0:
            self._floors.pop(near.pair, None)
            return None
        floor = self._floors.get(near.pair)
        first = self._robots_of(near.pair) not in self._seen or moved
        if floor is None or moved:
            self._floors[near.pair] = near.low
            if first:
                self.account.retreats += 1
                return None
            return self._too_near(near, sample, self.cell.pairs[near.pair].limit, "are required")
        slack = tol.PAIR_SLACK if near.low > 0.0 else tol.DEEP_SLACK
        if near.high >= floor - slack:
            return None
        self._floors[near.pair] = near.low
        return self._too_near(near, sample, floor, "apart is where the retreat began")

    def _too_near(self, near: Nearness, sample: Sample, bound: float, what: str) -> Finding:
        names = pair_names(self.cell, self.cell.pairs[near.pair])
        where = " and ".join(
            f"the {POSITIONS[pose]} of {name.partition('/')[0]}"
            for name, pose in zip(names, near.at, strict=True)
            if "/" in name
        )
        text = (
            f"{names[0]} and {names[1]} are {1e3 * near.low:.3f} to {1e3 * near.high:.3f} mm apart "
            f"at {where}; {1e3 * bound:.3f} mm {what}"
        )
        return Finding(
            "clearance", sample.robot, sample.tick, sample.time, text, near.high, bound, pair=names
        )

    def _note_smallest(self, sample: Sample) -> None:
        for kind, near in self._clearances.least.items():
            known = self.account.smallest.get(kind)
            if known is None or near.low < known.distance:
                pair = self.cell.pairs[near.pair]
                self.account.smallest[kind] = Smallest(
                    kind, near.low, pair.limit, pair_names(self.cell, pair), sample.tick, sample.time,
                    sample.robot,
                )  # fmt: skip

    def _reported(self, sample: Sample) -> list[Finding]:
        """Recompute, now and then, one of the distances that the state reports as certified."""
        self._asked[sample.robot] = self._asked.get(sample.robot, 0) + 1
        turn, rest = divmod(self._asked[sample.robot], _ASKED_EVERY)
        if rest or not sample.nearest:
            return []
        a, b, distance = sample.nearest[turn % len(sample.nearest)]
        if a not in self._bodies or b not in self._bodies:
            return []  # parts of a mesh, or a body that only the daemon knows: the description tells that
        if self._robots_named(a, b) != {self._index[sample.robot]}:
            return []  # other robots may be elsewhere by now
        found = self._clearances.at_measured(self._bodies[a], self._bodies[b])
        slack = tol.DISTANCE + self._measuring_slack(a, b)
        if distance <= found.high + slack:
            return []
        text = (
            f"{a} and {b} are said to be at least {1e3 * distance:.3f} mm apart; "
            f"they are {1e3 * found.high:.3f} mm apart at most"
        )
        return [
            Finding(
                "distance", sample.robot, sample.tick, sample.time, text, distance, found.high, pair=(a, b)
            )
        ]

    def _robots_named(self, *names: str) -> set[int]:
        robots = (self.cell.bodies[self._bodies[name]].robot for name in names)
        return {robot for robot in robots if robot is not None}

    def _measuring_slack(self, a: str, b: str) -> float:
        pair = self._clearances.pair_of(self._bodies[a], self._bodies[b])
        if pair is None:
            return 0.0
        return sum(self._clearances.lever(pair, robot) for robot in self._robots_of(pair))

    # --- findings -----------------------------------------------------------------------------------------

    def _reopen(self, sample: Sample) -> None:
        """Let a rule that is still broken be found again when a stop of the robot was lifted."""
        before = self._stops.get(sample.robot, frozenset())
        if before > sample.stops:
            self._open = {key for key in self._open if key[0] != sample.robot}
        self._stops[sample.robot] = sample.stops

    def _report(self, sample: Sample, found: list[Finding]) -> list[Finding]:
        """Return the findings that were not there at the robot's state before."""

        def key(finding: Finding) -> tuple[str, str]:
            return finding.robot, f"{finding.kind} {finding.pair or finding.joint or ''}"

        now = {key(finding) for finding in found}
        new = [finding for finding in found if key(finding) not in self._open]
        self._open = {k for k in self._open if k[0] != sample.robot} | now
        self._add(new)
        return new

    def _add(self, found: list[Finding]) -> None:
        self.account.violations += len(found)
        self.account.findings += found[: max(0, _KEPT - len(self.account.findings))]

"""Core of the monitor: findings from the states of robots. It uses no clock, socket or file."""

from collections.abc import Iterable

import numpy as np

from armgate.monitor import tolerances as tol
from armgate.monitor.clearance import Clearances, ClosePair, pair_names
from armgate.monitor.findings import POSITIONS, Finding, SmallestClearance, Summary
from armgate.monitor.model import Cell
from armgate.monitor.motion import Motion
from armgate.monitor.tick_state import TickState

_KEPT = 1000
"""Number of findings that are kept; further ones are only counted."""

_RECOMPUTED_EVERY = 8
"""A reported distance is recomputed in every n-th state of a robot."""


class Monitor:
    """Monitor of a cell, which checks the states of its robots.

    Args:
        cell: The cell.
        silence: Time without a state after which a robot counts as silent, s.
        measured_every: The smallest clearances are measured at every n-th tick; limits are checked at each
            tick.
        lockstep: True if time is virtual and each tick has its exact time.
    """

    def __init__(
        self, cell: Cell, silence: float = tol.SILENCE, measured_every: int = 1, *, lockstep: bool = False
    ) -> None:
        self.cell = cell
        self.summary = Summary(unseen=[robot.name for robot in cell.robots])
        self._silence = silence
        self._measured_every = measured_every
        self._index = {robot.name: r for r, robot in enumerate(cell.robots)}
        self._motions = [Motion(robot, lockstep) for robot in cell.robots]
        self._clearances = Clearances(cell)
        self._floors: dict[int, float] = {}
        self._seen: set[frozenset[int]] = set()
        self._silent: set[int] = set()
        self._measured: set[int] = set()
        self._ongoing: set[tuple[str, str]] = set()
        self._stops: dict[str, frozenset[int]] = {}
        self._turns: dict[str, int] = {}
        self._ended: set[int] = set()
        self._ready: set[str] = set()
        self._bodies = {body.name: i for i, body in enumerate(cell.bodies) if not body.meshed}

    def check(self, state: TickState, others: Iterable[TickState] = ()) -> list[Finding]:
        """Check one robot at one of its ticks; return the new findings.

        Args:
            state: The robot at its tick.
            others: Other robots in the same message; each also has states of its own.
        """
        self._reopen(state)
        if (wrong := self._form_error(state)) is not None:
            return self._new_findings(state, [wrong])
        robot = self._index[state.robot]
        motion = self._motions[robot]
        self._count(motion, state)
        self._forget_outdated(state)
        self.set_link(state.robot, ended=state.ended)
        for other in others:
            self._update_other(state, other)
        poses, found = motion.check(state)
        self._clearances.set_poses(robot, poses)
        found += self._check_clearances(robot, state, motion.moved)
        found += self._check_reported(state)
        found += self._silent_robots(state)
        return self._new_findings(state, found)

    def is_newest_tick(self, state: TickState) -> bool:
        """Return True if a state has the number, time and measured position of its robot's newest tick."""
        index = self._index.get(state.robot)
        last = None if index is None else self._motions[index].last
        if last is None or (last.tick, last.time) != (state.tick, state.time):
            return False
        return np.array_equal(last.q, state.q)

    def check_again(self, state: TickState) -> list[Finding]:
        """Check another state of a robot at its newest tick; return the new findings.

        A recording contains such states: a change of a link comes without a tick, so the daemon records all
        robots again, with their newest plans and stops. These states are not counted.
        """
        self._reopen(state)
        if (wrong := self._form_error(state)) is not None:
            return self._new_findings(state, [wrong])
        robot = self._index[state.robot]
        self.set_link(state.robot, ended=state.ended)
        for other in range(len(self._motions)):
            self._clearances.forget_stop_ends(other)  # other robots may have new plans, too
        poses, found = self._motions[robot].check_again(state)
        self._clearances.set_poses(robot, poses)
        found += self._check_clearances(robot, state, self._motions[robot].moved)
        return self._new_findings(state, found, all_rules=False)

    def add_differences(self, texts: Iterable[str]) -> list[Finding]:
        """Add the differences between the described cell and the configuration; return the findings."""
        found = [Finding("cell", "", 0, 0.0, text) for text in texts]
        self._add(found)
        return found

    def add_unseen(self) -> list[Finding]:
        """Add a finding for each robot without any state whose link was ready, at the end of a recording."""
        names = [name for name in self.summary.unseen if name in self._ready]
        found = [Finding("silence", name, 0, 0.0, "no state, although its link was ready") for name in names]
        self._add(found)
        return found

    def set_link(self, robot: str, *, ended: bool) -> None:
        """Store whether the link of a robot has ended, because its states may then stop."""
        if not ended:
            self._ready.add(robot)
        if (index := self._index.get(robot)) is not None:
            (self._ended.add if ended else self._ended.discard)(index)

    def add_silence(self, seconds: float) -> list[Finding]:
        """Note that no state of any robot was received for this time; return the findings, one per robot."""
        found = []
        for index, motion in enumerate(self._motions):
            last = motion.last
            if last is not None and seconds > self._silence and index not in self._silent | self._ended:
                self._silent.add(index)
                text = f"no state for {seconds:.2f} s"
                found.append(Finding("silence", last.robot, last.tick, last.time, text))
        self._add(found)
        return found

    def _forget_outdated(self, state: TickState) -> None:
        """Forget plans that other robots may have replaced, and poses of robots whose states are missing."""
        for other, motion in enumerate(self._motions):
            if motion.last is None:
                continue
            age = state.time - motion.last.time
            if age > tol.STALE * motion.robot.period:
                self._clearances.forget(other)
            elif abs(age) > tol.STEP:
                self._clearances.forget_stop_ends(other)

    def _update_other(self, state: TickState, other: TickState) -> None:
        """Use the position of another robot, unless it is too old by its own time."""
        if self._form_error(other) is not None:
            return
        index = self._index[other.robot]
        self.set_link(other.robot, ended=other.ended)
        if state.time - other.time <= tol.STALE * self.cell.robots[index].period:
            poses = np.stack([other.q, other.setpoint, other.stop_end, other.stop_end])
            self._clearances.set_poses(index, poses)

    # --- form and coverage --------------------------------------------------------------------------------

    def _form_error(self, state: TickState) -> Finding | None:
        robot = self._index.get(state.robot)
        n = 0 if robot is None else self.cell.robots[robot].n
        if robot is not None and all(len(x) == n for x in (state.q, state.setpoint, state.stop_end)):
            return None
        text = f"a state with another number of joints than in the configuration ({n})"
        return Finding("form", state.robot, state.tick, state.time, text)

    def _count(self, motion: Motion, state: TickState) -> None:
        self.summary.states += 1
        self.summary.positions += 3
        if motion.last is None:
            self.summary.unseen.remove(state.robot)
        if motion.last is not None and state.tick > motion.last.tick + 1:
            missed = state.tick - motion.last.tick - 1
            self.summary.missed[state.robot] = self.summary.missed.get(state.robot, 0) + missed

    def _silent_robots(self, state: TickState) -> list[Finding]:
        """Return a finding for each robot whose newest state is too old by the times of the states."""
        found = []
        for index, motion in enumerate(self._motions):
            last = motion.last
            if last is None or state.time - last.time <= self._silence:
                self._silent.discard(index)
            elif index not in self._silent | self._ended:
                self._silent.add(index)
                text = f"no state for {state.time - last.time:.2f} s while other robots tick"
                found.append(Finding("silence", last.robot, last.tick, last.time, text))
        return found

    # --- clearances ---------------------------------------------------------------------------------------

    def _check_clearances(self, robot: int, state: TickState, moved: bool) -> list[Finding]:
        found = []
        measure = (state.tick + robot) % self._measured_every == 0 or robot not in self._measured
        self._measured.add(robot)
        checked = {near.pair: near for near in self._clearances.check(robot, measure=measure)}
        self._note_smallest(state)
        for pair in [pair for pair in self._floors if pair not in checked and self._concerns(pair, robot)]:
            del self._floors[pair]
        for near in checked.values():
            finding = self._check_pair(near, state, moved)
            if finding is not None:
                found.append(finding)
        self._seen.add(frozenset([robot]))
        self._seen |= {
            frozenset([robot, other]) for other, m in enumerate(self._motions) if m.last is not None
        }
        return found

    def _concerns(self, pair: int, robot: int) -> bool:
        """Return True if a pair belongs to this robot and the poses of both bodies are known."""
        robots = self._robots_of(pair)
        return robot in robots and all(self._clearances.has_poses(one) for one in robots)

    def _robots_of(self, pair: int) -> frozenset[int]:
        both = self.cell.pairs[pair]
        robots = (self.cell.bodies[both.a].robot, self.cell.bodies[both.b].robot)
        return frozenset(robot for robot in robots if robot is not None)

    # A pair is in one of two states. Without a floor its limit applies. If the limit is violated when the
    # pair is first checked, or after a reset at another position, that is not a finding: the pair gets a
    # floor, its certified distance, below which the distance must not fall. A finding also sets a floor, so
    # that a retreat is not reported again. The floor is removed when the distance reaches the limit again.

    def _check_pair(self, near: ClosePair, state: TickState, moved: bool) -> Finding | None:
        """Compare a close pair with its limit, or with its floor if it was violated before."""
        if near.lacking <= 0.0:
            self._floors.pop(near.pair, None)
            return None
        floor = self._floors.get(near.pair)
        first = self._robots_of(near.pair) not in self._seen or moved
        if floor is None or moved:
            self._floors[near.pair] = near.low
            if first:
                self.summary.retreats += 1
                return None
            return self._clearance_finding(near, state, self.cell.pairs[near.pair].limit, "are required")
        slack = tol.PAIR_SLACK if near.low > 0.0 else tol.DEEP_SLACK
        if near.high >= floor - slack:
            return None
        self._floors[near.pair] = near.low
        return self._clearance_finding(near, state, floor, "was the distance when the retreat began")

    def _clearance_finding(self, near: ClosePair, state: TickState, bound: float, what: str) -> Finding:
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
        return Finding("clearance", state.robot, state.tick, state.time, text, near.high, bound, pair=names)

    def _note_smallest(self, state: TickState) -> None:
        for kind, near in self._clearances.least.items():
            known = self.summary.smallest.get(kind)
            if known is None or near.low < known.distance:
                pair = self.cell.pairs[near.pair]
                self.summary.smallest[kind] = SmallestClearance(
                    kind, near.low, pair.limit, pair_names(self.cell, pair), state.tick, state.time,
                    state.robot,
                )  # fmt: skip

    def _check_reported(self, state: TickState) -> list[Finding]:
        """Recompute one of the reported distances, in one of ``_RECOMPUTED_EVERY`` states."""
        self._turns[state.robot] = self._turns.get(state.robot, 0) + 1
        turn, rest = divmod(self._turns[state.robot], _RECOMPUTED_EVERY)
        if rest or not state.nearest:
            return []
        a, b, distance = state.nearest[turn % len(state.nearest)]
        if a not in self._bodies or b not in self._bodies:
            return []  # parts of a mesh, or a body that only the daemon has: the description check reports it
        if self._robots_named(a, b) != {self._index[state.robot]}:
            return []  # other robots may have moved since
        found = self._clearances.at_measured(self._bodies[a], self._bodies[b])
        slack = tol.DISTANCE + self._measuring_slack(a, b)
        if distance <= found.high + slack:
            return []
        text = (
            f"{a} and {b} are reported to be at least {1e3 * distance:.3f} mm apart; "
            f"they are at most {1e3 * found.high:.3f} mm apart"
        )
        return [
            Finding("distance", state.robot, state.tick, state.time, text, distance, found.high, pair=(a, b))
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

    def _reopen(self, state: TickState) -> None:
        """After a stop of the robot was reset, treat violations that still exist as new findings."""
        before = self._stops.get(state.robot, frozenset())
        if before > state.stops:
            self._ongoing = {key for key in self._ongoing if key[0] != state.robot}
        self._stops[state.robot] = state.stops

    def _new_findings(
        self, state: TickState, found: list[Finding], *, all_rules: bool = True
    ) -> list[Finding]:
        """Return the findings that the robot's previous state did not have.

        Args:
            state: The state.
            found: Its findings.
            all_rules: True if all rules were checked, so that violations without a finding have ended.
        """

        def key(finding: Finding) -> tuple[str, str]:
            return finding.robot, f"{finding.kind} {finding.pair or finding.joint or ''}"

        now = {key(finding) for finding in found}
        new = [finding for finding in found if key(finding) not in self._ongoing]
        if all_rules:
            self._ongoing = {k for k in self._ongoing if k[0] != state.robot}
        self._ongoing |= now
        self._add(new)
        return new

    def _add(self, found: list[Finding]) -> None:
        self.summary.violations += len(found)
        self.summary.findings += found[: max(0, _KEPT - len(self.summary.findings))]

"""Checks of one daemon's gate, from its events and outputs: leases, stops, ticks of commands, and plans.

The checks keep a model of their own. They share no code with the gate, the leases or the stops of armgate.
"""

import math
from collections.abc import Callable, Mapping

from armgate import events as e
from armgate.cell.cell import Cell
from armgate.gate import Gate, RobotView
from tools.simulate.cells import KEPT, clearance
from tools.simulate.findings import Findings

_ROUNDING = 1e-9
_SEPARATED = 3
"""Every so many plans, the clearance while both robots come to rest is checked."""

_NEAR = 1e-6
"""Tolerance of distances, m: the rounding of both models."""

Time = Callable[[], int]


class GateChecks:
    """`Gate` that checks its events and outputs.

    Args:
        gate: The gate.
        cell: The cell.
        findings: Receives violations.
        seen: Called with every event and its outputs.
        attached: Returns the number of connections of daemons to the robot server; 0 if there is none.
    """

    def __init__(
        self,
        gate: Gate,
        cell: Cell,
        findings: Findings,
        seen: Callable[[e.GateEvent, list[e.GateOutput]], None],
        attached: Callable[[], int],
    ) -> None:
        self._gate, self._findings, self._seen, self._attached = gate, findings, seen, attached
        self._max_age = cell.config.max_age_ticks
        self._limits = {robot.name: robot for robot in cell.robots}
        self._fences: dict[str, int | None] = {robot.name: None for robot in cell.robots}
        self._highest = dict.fromkeys(self._fences, 0)
        self._ready = dict.fromkeys(self._fences, False)
        self._armed = dict.fromkeys(self._fences, False)
        self._stops: dict[int, set[str]] = {}
        self._ticks: dict[str, e.Tick] = {}
        self._held: dict[str, e.Plan] = {}
        self._offered: dict[tuple[str, e.PlanKey], e.Plan] = {}
        self._accepted = 0

    def step(self, event: e.GateEvent) -> list[e.GateOutput]:
        """Process one event, and check it with its outputs."""
        outputs = self._gate.step(event)
        self._seen(event, outputs)
        match event:
            case e.LeaseChange():
                self._lease(event)
            case e.Tick():
                self._tick(event)
            case e.Command():
                self._command(event, outputs)
            case e.PlanAnswer():
                self._answer(event)
            case e.LinkChange():
                self._link(event)
            case e.Stop() | e.Reset():
                pass
        for output in outputs:
            match output:
                case e.Plan():
                    self._plan(output)
                case e.Stopped():
                    self._stopped(output)
                case e.ResetAnswer() if output.accepted:
                    self._stops.pop(output.stop, None)
                    self._stops.pop(-1 if output.lifted is None else output.lifted, None)
                case e.Rebase():
                    self._held.pop(output.robot, None)
                    self._armed[output.robot] = True
                case _:
                    pass
        return outputs

    def view(self, robot: str) -> RobotView:
        """Return the gate's view of one robot."""
        return self._gate.view(robot)

    def warnings(self) -> tuple[str, ...]:
        """Return the gate's warnings."""
        return self._gate.warnings()

    @property
    def fences(self) -> Mapping[str, int | None]:
        """Fence of each robot's lease; None if it is not held."""
        return self._fences

    @property
    def stops(self) -> Mapping[int, set[str]]:
        """Stops in force."""
        return self._stops

    @property
    def ready(self) -> bool:
        """True if the link of a robot is ready."""
        return any(self._ready.values())

    # --- leases and stops -----------------------------------------------------------------------------------

    def _lease(self, change: e.LeaseChange) -> None:
        robot, fence = change.robot, change.fence
        if fence is not None:
            self._check(
                fence > self._highest[robot], "fences grow", lambda: f"{robot}: {fence} after {self._highest}"
            )
            self._check(
                not self._stopped_robot(robot), "no lease while stopped", lambda: f"{robot} fence {fence}"
            )
            self._highest[robot] = max(fence, self._highest[robot])
        self._fences[robot] = fence

    def _stopped(self, stopped: e.Stopped) -> None:
        if stopped.replaces is not None:
            self._stops.pop(stopped.replaces, None)
        self._stops[stopped.id] = set(stopped.robots)

    def _stopped_robot(self, robot: str) -> bool:
        return any(robot in robots for robots in self._stops.values())

    # --- ticks and commands ---------------------------------------------------------------------------------

    def _tick(self, tick: e.Tick) -> None:
        before = self._ticks.get(tick.robot)
        self._check(
            before is None or tick.tick == before.tick + 1 or tick.tick > before.tick,
            "ticks grow",
            lambda: f"{tick.robot}: {tick.tick} after {before}",
        )
        self._ticks[tick.robot] = tick

    def _command(self, command: e.Command, outputs: list[e.GateOutput]) -> None:
        verdicts = [output for output in outputs if isinstance(output, e.Verdict)]
        self._check(len(verdicts) == 1, "one verdict per command", lambda: f"{command}: {len(verdicts)}")
        for verdict in verdicts:
            same = (verdict.robot, verdict.seq) == (command.robot, command.seq)
            self._check(same, "verdict of its command", lambda: f"{command}: {verdicts}")
            if verdict.outcome is not e.Outcome.REFUSED:
                self._admitted(command)

    def _admitted(self, command: e.Command) -> None:
        robot, tick = command.robot, self._ticks.get(command.robot)
        text = lambda: f"{command} admitted; fences {self._fences}, stops {self._stops}, tick {tick}"  # noqa: E731
        self._check(command.holder and command.fence == self._fences[robot], "commands need the lease", text)
        self._check(not self._stopped_robot(robot), "stops latch", text)
        self._check(self._ready[robot], "commands need a ready link", text)
        fresh = tick is not None and 0 <= tick.tick - command.based_on <= self._max_age
        self._check(fresh, "commands name a recent tick", text)
        self._check(all(map(math.isfinite, command.dq)), "commands are finite", text)

    def _link(self, change: e.LinkChange) -> None:
        self._ready[change.robot] = ready = change.state is e.LinkState.READY
        if not ready:
            self._armed[change.robot] = False
        elif self._attached() > 1:
            text = lambda: f"{change} to connection {self._attached()} without a reset"  # noqa: E731
            self._check(self._armed[change.robot], "links never re-arm by themselves", text)

    # --- plans ----------------------------------------------------------------------------------------------

    def _answer(self, answer: e.PlanAnswer) -> None:
        plan = self._offered.pop((answer.robot, answer.key), None)
        if answer.accepted and plan is not None:
            self._held[answer.robot] = plan
            self._accepted += 1
            if self._accepted % _SEPARATED == 0:
                self._separate(plan)

    def _plan(self, plan: e.Plan) -> None:
        self._offered[plan.robot, plan.key] = plan
        robot, tick = self._limits[plan.robot], self._ticks[plan.robot]
        largest = robot.velocity * robot.period + _ROUNDING
        braking = robot.deceleration * robot.period**2 + _ROUNDING
        steps = plan.increments
        text = lambda: f"{plan} after {tick}"  # noqa: E731
        for increment in steps:
            self._check(
                all(abs(d) <= m for d, m in zip(increment, largest, strict=True)), "speed limits", text
            )
        for one, other in zip(steps, (*steps[1:], (0.0,) * len(largest)), strict=True):
            slower = all(abs(b - a) <= m for a, b, m in zip(one, other, braking, strict=True))
            self._check(slower, "plans brake to rest", text)
        q = tick.setpoint
        for increment in steps:
            q = tuple(a + d for a, d in zip(q, increment, strict=True))
            inside = all(
                low - _ROUNDING <= x <= high + _ROUNDING
                for x, low, high in zip(q, robot.lower, robot.upper, strict=True)
            )
            self._check(inside, "plans stay within joint limits", text)

    def _separate(self, plan: e.Plan) -> None:
        """Check the clearance while this robot and the others play their plans to rest."""
        paths = {robot: self._path(robot) for robot in self._ticks}
        longest = max(len(path) for path in paths.values())
        for k in range(longest):
            q = {robot: path[min(k, len(path) - 1)] for robot, path in paths.items()}
            least = clearance(q)
            if least < KEPT - _NEAR:
                self._findings.report("every plan can stop", f"{least} m at {q}: {plan}")

    def _path(self, robot: str) -> list[e.Joints]:
        tick = self._ticks[robot]
        path, held = [tick.setpoint], self._held.get(robot)
        if held is None:
            return path
        done = tick.tick - held.key.target + 1
        for increment in held.increments[max(0, done) :]:
            path.append(tuple(a + d for a, d in zip(path[-1], increment, strict=True)))
        return path

    def _check(self, holds: bool, invariant: str, text: Callable[[], str]) -> None:
        self._findings.check(holds, invariant, text)

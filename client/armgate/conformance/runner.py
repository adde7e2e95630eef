"""Runs cases one after the other, and brings the cell back to rest after each."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count

from armgate.conformance.case import Case
from armgate.conformance.ledger import Ledger
from armgate.conformance.observer import Observer
from armgate.conformance.target import Facts, Target
from armgate.conformance.trial import Trial, lifted
from armgate.conformance.verdicts import Outcome, Skip, Unmet
from armgate.conformance.wire import Wire
from armgate.protocol.statements import When

_STARVED = 0.3
"""No state for so long, s: on so busy a machine time limits say nothing: a conversation is tried again."""

_AGAIN = 4
"""How often a case is tried at most. What a robot did wrong is never tried away."""

_LONGEST = 60.0
"""How long one case may take in all, s."""


@dataclass(frozen=True)
class Result:
    """What one case came to.

    Attributes:
        case: The case.
        safety: Whether a robot did what it must not.
        session: Whether the conversation went as written.
        findings: What was wrong, or why it was skipped.
        seconds: How long it took.
        wire: The wire log's lines; kept where something was wrong.
    """

    case: Case
    safety: Outcome
    session: Outcome
    findings: tuple[str, ...] = ()
    seconds: float = 0.0
    wire: tuple[str, ...] = ()

    @property
    def outcome(self) -> Outcome:
        """The worse of both verdicts."""
        return max(self.safety, self.session, key=lambda verdict: verdict.badness)

    def failed(self, strict: bool) -> bool:
        """Whether it counts as failed."""
        return self.outcome is Outcome.FAIL or (strict and self.outcome is Outcome.NON_STRICT)


class Runner:
    """Runs cases against one server.

    Args:
        target: The server.
        facts: What it said of itself.
    """

    def __init__(self, target: Target, facts: Facts) -> None:
        self._target = target
        self._facts = facts
        self._observer: Observer | None = None
        self._numbers = count(1)
        self._ledger = Ledger()

    async def run(self, cases: Sequence[Case]) -> AsyncIterator[Result]:
        """Results as they come."""
        try:
            for case in cases:
                yield await self._result(case)
        finally:
            if self._observer is not None:
                await self._observer.close()

    async def _result(self, case: Case) -> Result:
        if reason := self._elsewhere(case):
            return Result(case, Outcome.SKIPPED, Outcome.SKIPPED, (reason,))
        for _ in range(_AGAIN):
            result, gap = await self._tried(case)
            if gap < _STARVED or result.safety is Outcome.FAIL or result.session is not Outcome.FAIL:
                break
        return result

    async def _tried(self, case: Case) -> tuple[Result, float]:
        """What a case came to, and the longest time for which no state came."""
        start = asyncio.get_running_loop().time()
        try:
            observer = await self._looking()
        except (OSError, TimeoutError, Unmet) as error:
            told = f"the server cannot be observed any more: {error}"
            return Result(case, Outcome.FAIL, Outcome.FAIL, (told,)), 0.0
        observer.begin()
        trial = Trial(self._target, self._facts, observer, self._ledger)
        session, said = await self._conversation(case, trial)
        found = await self._aftermath(trial)
        safety = Outcome.FAIL if found else Outcome.SKIPPED if session is Outcome.SKIPPED else Outcome.PASS
        findings = (*(f"session: {text}" for text in said), *(f"safety: {text}" for text in found))
        good = not found and session in (Outcome.PASS, Outcome.SKIPPED)
        seconds = asyncio.get_running_loop().time() - start
        wire = () if good else tuple(trial.log.lines())
        return Result(case, safety, session, findings, seconds, wire), observer.gap

    def _elsewhere(self, case: Case) -> str:
        """Why this case is not for this server, "" if it is."""
        if (case.when is When.LOCKSTEP) is not self._facts.lockstep:
            return (
                f"only for a server {'in lock-step' if case.when is When.LOCKSTEP else 'by the wall clock'}"
            )
        if case.when is When.TOKENS and self._target.token is None:
            return "only for a server with tokens: give --token-file"
        if case.when is When.TLS and self._target.tls is None:
            return "only for a server with TLS: give --tls-ca"
        return ""

    async def _conversation(self, case: Case, trial: Trial) -> tuple[Outcome, list[str]]:
        told: list[str] = []
        try:
            async with asyncio.timeout(_LONGEST + 10 * self._target.faults.delay):
                await case.body(trial)
                await self._answered(trial)
        except Skip as reason:
            return Outcome.SKIPPED, [str(reason)]
        except Unmet as fault:
            told.append(str(fault))
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            told.append(f"the server said what the case cannot make sense of: {error!r}")
        except TimeoutError:
            told.append(f"not over within {_LONGEST:g} s")
        told += [fault for wire in trial.wires for fault in wire.faults]
        if not told:
            return Outcome.PASS, []
        wrong = any(wire.faults for wire in trial.wires) or not case.should
        return Outcome.FAIL if wrong else Outcome.NON_STRICT, told

    async def _answered(self, trial: Trial) -> None:
        """Every command of a connection that still stands must have been answered, once."""
        for wire in trial.wires:
            if wire.account.busy and wire.alive and not self._facts.lockstep:
                await wire.in_step()
                if left := wire.account.unanswered:
                    raise Unmet(
                        f"{wire.name}: no answer to the commands {left} though a later ping has its pong"
                    )

    async def _aftermath(self, trial: Trial) -> list[str]:
        """Close everything, let all robots rest, lift stops; what was wrong with what robots did."""
        observer = trial.observer
        for wire in trial.wires:
            wire.close()
        found = []
        try:
            if not self._facts.lockstep:
                await self._back_to_rest(observer)
        except (OSError, TimeoutError, Unmet) as error:
            found.append(f"after the case, with all its connections closed: {error}")
            await self._recover(observer)
        return observer.findings(trial.ledger) + found

    async def _back_to_rest(self, observer: Observer) -> None:
        goals = {robot: observer.tick(robot) + 2 for robot in observer.entries}
        await observer.until(lambda: all(observer.tick(r) >= goal for r, goal in goals.items()), "two ticks")
        try:
            await observer.until(lambda: not [*observer.unrest()], "rest")
        except Unmet as error:
            raise Unmet("; ".join(observer.unrest()) or str(error)) from None
        if stops := observer.stops():
            operator = await self._target.helper(f"kit-op-{next(self._numbers)}", "operator")
            for stop in sorted(stops):
                await lifted(operator, stop, observer)
            operator.close()
            await observer.until(lambda: not observer.stops(), "the stops to be lifted")

    async def _recover(self, observer: Observer) -> None:
        """Bring a server that failed to give a robot back to where the next case can begin, if it lets us."""
        with suppress(OSError, TimeoutError, Unmet):
            operator = await self._target.helper(f"kit-op-{next(self._numbers)}", "operator")
            for robot, entry in observer.entries.items():
                if entry["holder"] is not None:
                    lease = await operator.answered("acquire", "lease", robot=robot, takeover=True)
                    await operator.answered("release", "lease", robot=robot, fence=lease["fence"])
            await self._back_to_rest(observer)

    async def _looking(self) -> Observer:
        if self._observer is None or self._observer.blind:
            wire: Wire = await self._target.helper(f"kit-observer-{next(self._numbers)}", "observer")
            self._observer = Observer(wire, self._facts.description)
            await self._observer.watch()
            if not self._facts.lockstep:  # what a robot does next is judged by what it did before
                await self._observer.ticks(self._facts.robot["name"], 3)
            applied = [e["applied_seq"] or 0 for e in self._observer.entries.values()]
            self._ledger.seqs = count(max([*applied, next(self._ledger.seqs)]) + 1)
        return self._observer

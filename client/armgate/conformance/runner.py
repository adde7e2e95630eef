"""Runner of cases, one after the other; after each case all robots come to rest again."""

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import assert_never

from armgate.conformance.case import Case, Outcome, Skip, Violation
from armgate.conformance.command_log import CommandLog
from armgate.conformance.context import CaseContext, reset_stop
from armgate.conformance.observer import Observer
from armgate.conformance.target import ServerInfo, Target
from armgate.protocol.spec_statements import When

_STARVED = 0.3
"""Time without a state, s, after which the machine counts as too busy: a failed session is run again."""

_ATTEMPTS = 4
"""Largest number of attempts of a case. A failed safety outcome is final: no later attempt replaces it."""

_LONGEST = 60.0
"""Longest duration of a case, s."""


@dataclass(frozen=True)
class Result:
    """Result of one case.

    Attributes:
        case: The case.
        safety: Outcome for the motion of robots.
        session: Outcome for the conversation.
        findings: Errors found, or the reason why the case was skipped.
        seconds: Duration, s.
        wire: Lines of the wire log; empty unless something was wrong.
    """

    case: Case
    safety: Outcome
    session: Outcome
    findings: tuple[str, ...] = ()
    seconds: float = 0.0
    wire: tuple[str, ...] = ()

    @property
    def outcome(self) -> Outcome:
        """The worse of the two outcomes."""
        return max(self.safety, self.session, key=lambda outcome: outcome.severity)

    def failed(self, strict: bool) -> bool:
        """Return True if the case counts as failed."""
        return self.outcome is Outcome.FAIL or (strict and self.outcome is Outcome.NON_STRICT)


class Runner:
    """Runner of cases against one server.

    Args:
        target: The server.
        server: Its welcome and its cell.
    """

    def __init__(self, target: Target, server: ServerInfo) -> None:
        self._target = target
        self._server = server
        self._observer: Observer | None = None
        self._numbers = count(1)
        self._commands = CommandLog()

    async def run(self, cases: Sequence[Case]) -> AsyncIterator[Result]:
        """Run cases, and yield each result."""
        try:
            for case in cases:
                yield await self._result(case)
        finally:
            if self._observer is not None:
                await self._observer.close()

    async def _result(self, case: Case) -> Result:
        if reason := self._not_applicable(case):
            return Result(case, Outcome.SKIPPED, Outcome.SKIPPED, (reason,))
        for _ in range(_ATTEMPTS):
            result, gap = await self._attempt(case)
            if gap < _STARVED or result.safety is Outcome.FAIL or result.session is not Outcome.FAIL:
                break
        return result

    async def _attempt(self, case: Case) -> tuple[Result, float]:
        """Run a case once; return its result, and the longest time for which no state came."""
        start = asyncio.get_running_loop().time()
        try:
            observer = await self._connected_observer()
        except (OSError, TimeoutError, Violation) as error:
            text = f"the server can no longer be observed: {error}"
            return Result(case, Outcome.FAIL, Outcome.FAIL, (text,)), 0.0
        observer.begin_case()
        context = CaseContext(self._target, self._server, observer, self._commands)
        session, wrong = await self._converse(case, context)
        unsafe = await self._clean_up(context)
        safety = Outcome.FAIL if unsafe else Outcome.SKIPPED if session is Outcome.SKIPPED else Outcome.PASS
        findings = (*(f"session: {text}" for text in wrong), *(f"safety: {text}" for text in unsafe))
        good = not unsafe and session in (Outcome.PASS, Outcome.SKIPPED)
        seconds = asyncio.get_running_loop().time() - start
        wire = () if good else tuple(context.log.lines())
        return Result(case, safety, session, findings, seconds, wire), observer.gap

    def _not_applicable(self, case: Case) -> str:
        """Return why this case does not apply to this server; "" if it does."""
        if (case.when is When.LOCKSTEP) is not self._server.lockstep:
            pace = "in lock-step" if case.when is When.LOCKSTEP else "by the wall clock"
            return f"only for a server {pace}"
        match case.when:
            case When.TOKENS:
                missing = self._target.token is None
                return "only for a server with tokens: give --token-file" if missing else ""
            case When.TLS:
                return "only for a server with TLS: give --tls-ca" if self._target.tls is None else ""
            case When.ALWAYS | When.CLOCK | When.LOCKSTEP:
                return ""
            case _:
                assert_never(case.when)

    async def _converse(self, case: Case, context: CaseContext) -> tuple[Outcome, list[str]]:
        """Run the body of a case; return the outcome of the session, and the errors found."""
        wrong: list[str] = []
        try:
            async with asyncio.timeout(_LONGEST + 10 * self._target.faults.delay):
                await case.body(context)
                await self._check_answered(context)
        except Skip as reason:
            return Outcome.SKIPPED, [str(reason)]
        except Violation as error:
            wrong.append(str(error))
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            wrong.append(f"the case cannot interpret a message of the server: {error!r}")
        except TimeoutError:
            wrong.append(f"not finished within {_LONGEST:g} s")
        violations = [text for connection in context.connections for text in connection.violations]
        wrong += violations
        if not wrong:
            return Outcome.PASS, []
        return Outcome.FAIL if violations or not case.should else Outcome.NON_STRICT, wrong

    async def _check_answered(self, context: CaseContext) -> None:
        """Check that every command of a connection that is still open was answered once."""
        for connection in context.connections:
            if connection.verdicts.used and connection.alive and not self._server.lockstep:
                await connection.sync()
                if left := connection.verdicts.unanswered:
                    raise Violation(
                        f"{connection.name}: a later ping was answered, but the commands {left} were not"
                    )

    async def _clean_up(self, context: CaseContext) -> list[str]:
        """Close all connections, let all robots come to rest, reset stops; return the unsafe motions."""
        observer = context.observer
        for connection in context.connections:
            connection.close()
        found = []
        try:
            if not self._server.lockstep:
                await self._back_to_rest(observer)
        except (OSError, TimeoutError, Violation) as error:
            found.append(f"after the case, with all its connections closed: {error}")
            await self._recover(observer)
        return observer.findings(context.commands) + found

    async def _back_to_rest(self, observer: Observer) -> None:
        goals = {robot: observer.tick(robot) + 2 for robot in observer.entries}
        await observer.until(lambda: all(observer.tick(r) >= goal for r, goal in goals.items()), "two ticks")
        try:
            await observer.until(lambda: not [*observer.disturbances()], "rest")
        except Violation as error:
            raise Violation("; ".join(observer.disturbances()) or str(error)) from None
        if stops := observer.stops():
            operator = await self._target.own_client(f"kit-op-{next(self._numbers)}", "operator")
            for stop in sorted(stops):
                await reset_stop(operator, stop, observer)
            operator.close()
            await observer.until(lambda: not observer.stops(), "the stops to be reset")

    async def _recover(self, observer: Observer) -> None:
        """Try to free robots that the server has not freed, so that the next case can begin."""
        with suppress(OSError, TimeoutError, Violation):
            operator = await self._target.own_client(f"kit-op-{next(self._numbers)}", "operator")
            for robot, entry in observer.entries.items():
                if entry["holder"] is not None:
                    lease = await operator.call("acquire", "lease", robot=robot, takeover=True)
                    await operator.call("release", "lease", robot=robot, fence=lease["fence"])
            await self._back_to_rest(observer)

    async def _connected_observer(self) -> Observer:
        if self._observer is None or self._observer.disconnected:
            name = f"kit-observer-{next(self._numbers)}"
            connection = await self._target.own_client(name, "observer")
            self._observer = Observer(connection, self._server.description)
            await self._observer.start()
            if not self._server.lockstep:  # the checks compare each motion with the previous one
                await self._observer.ticks(self._server.robot["name"], 3)
            applied = [e["applied_seq"] or 0 for e in self._observer.entries.values()]
            self._commands.number_after(max(applied, default=0))
        return self._observer

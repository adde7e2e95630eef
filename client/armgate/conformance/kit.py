"""One run of the kit, from options to reports."""

import shlex
import ssl
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from armgate.conformance import page, report
from armgate.conformance.case import Case
from armgate.conformance.faults import Faults
from armgate.conformance.proxy import Proxy
from armgate.conformance.runner import Result, Runner
from armgate.conformance.serving import served
from armgate.conformance.target import Facts, Target, ask
from armgate.conformance.verdicts import Outcome


@dataclass
class Options:
    """What a run is to do; see the command."""

    address: tuple[str, int] | None
    start: str | None
    cases: Sequence[Case]
    strict: bool = False
    robot: str | None = None
    participants: tuple[str, ...] = ()
    tokens: dict[str, str] = field(default_factory=dict)
    tls: ssl.SSLContext | None = None
    faults: Faults = field(default_factory=Faults)
    seed: int = 1
    junit: Path | None = None
    html: Path | None = None
    wires: Path | None = None


async def run(options: Options, tell: Callable[[str], object]) -> int:
    """Try the cases, tell about each, write the reports.

    Args:
        options: What to do.
        tell: Given lines for people.

    Returns:
        Exit status: 0, 1 if a case failed, 2 if nothing could be tried.

    Raises:
        Unreachable: There is no server.
    """
    results: list[Result] = []
    async with reached(options) as (target, facts):
        async for result in Runner(target, facts).run(options.cases):
            results.append(result)
            if result.outcome is not Outcome.SKIPPED:
                tell(report.line(result))
            if result.outcome in (Outcome.FAIL, Outcome.NON_STRICT):
                tell(report.failure(result))
    _write(options, results, facts, f"{target.host}:{target.port}")
    for reason in report.reasons(results):
        tell(reason)
    if soft := sum(result.outcome is Outcome.NON_STRICT for result in results):
        tell(f"{soft} NON-STRICT: a SHOULD was not kept")
    tell(report.last_line(results, options.strict))
    if all(result.outcome is Outcome.SKIPPED for result in results):
        return 2  # nobody may take this for a server that passed
    return int(any(result.failed(options.strict) for result in results))


@asynccontextmanager
async def reached(options: Options) -> AsyncIterator[tuple[Target, Facts]]:
    """The server of a run and what it says of itself; started and ended here if the options say so."""
    async with AsyncExitStack() as stack:
        if options.address is not None:
            host, port = options.address
        else:
            host, port = await stack.enter_async_context(served(options.start or ""))
        target = Target(host, port, options.tokens, options.tls, options.faults)
        if (command := options.start) is not None:
            target.anew = lambda: served(command)
        facts = await ask(target, options.robot, options.participants)
        if options.faults != Faults():
            target.proxy = await stack.enter_async_context(Proxy(host, port, options.faults, options.seed))
        yield target, facts


def listing(cases: Sequence[Case]) -> str:
    """The cases, one a line."""
    return "\n".join(f"{case.id:<28} {case.description}" for case in cases)


def _write(options: Options, results: Sequence[Result], facts: Facts, where: str) -> None:
    if options.junit is not None:
        report.write_junit(results, options.junit, options.strict)
    if options.html is not None:
        text = page.page(results, facts, where, options.strict, shlex.join(sys.argv[1:]))
        options.html.write_text(text, encoding="utf-8", errors="replace")
    if options.wires is not None:
        report.write_wires(results, options.wires)

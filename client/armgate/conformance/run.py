"""One run of the kit, from its options to its reports."""

import shlex
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial

from armgate.conformance import report
from armgate.conformance.case import Case, Outcome
from armgate.conformance.fault_injection import Faults, Proxy
from armgate.conformance.html_report import html_page
from armgate.conformance.options import Options
from armgate.conformance.runner import Result, Runner
from armgate.conformance.server_process import running_server
from armgate.conformance.target import ServerInfo, Target, query_server


async def run(options: Options, echo: Callable[[str], object]) -> int:
    """Run the cases, print each result, write the reports.

    Args:
        options: Options of the run.
        echo: Prints a line.

    Returns:
        Exit status: 0, 1 if a case failed, 2 if no case could be run.

    Raises:
        Unreachable: There is no server.
    """
    results: list[Result] = []
    async with connected(options) as (target, server):
        async for result in Runner(target, server).run(options.cases):
            results.append(result)
            if result.outcome is not Outcome.SKIPPED:
                echo(report.line(result))
            if result.outcome in (Outcome.FAIL, Outcome.NON_STRICT):
                echo(report.failure(result))
    _write_reports(options, results, server, f"{target.host}:{target.port}")
    for reason in report.skip_reasons(results):
        echo(reason)
    if soft := sum(result.outcome is Outcome.NON_STRICT for result in results):
        echo(f"{soft} NON-STRICT: a SHOULD was violated")
    echo(report.last_line(results, options.strict))
    if all(result.outcome is Outcome.SKIPPED for result in results):
        return 2  # a server on which nothing was tested must not count as passed
    return int(any(result.failed(options.strict) for result in results))


@asynccontextmanager
async def connected(options: Options) -> AsyncIterator[tuple[Target, ServerInfo]]:
    """Connect to the server of a run; if the options name a command, start the server and end it."""
    async with AsyncExitStack() as stack:
        if options.address is not None:
            host, port = options.address
        else:
            host, port = await stack.enter_async_context(running_server(options.start or ""))
        proxy = None
        if options.faults != Faults():
            proxy = await stack.enter_async_context(Proxy(host, port, options.faults, options.seed))
        another = None if options.start is None else partial(running_server, options.start)
        target = Target(host, port, options.tokens, options.tls, options.faults, proxy, start_another=another)
        yield target, await query_server(target, options.robot, options.participants)


def list_cases(cases: Sequence[Case]) -> str:
    """Return the cases, one a line."""
    return "\n".join(f"{case.id:<28} {case.description}" for case in cases)


def _write_reports(options: Options, results: Sequence[Result], server: ServerInfo, where: str) -> None:
    if options.junit is not None:
        report.write_junit(results, options.junit, options.strict)
    if options.html is not None:
        text = html_page(results, server, where, options.strict, shlex.join(sys.argv[1:]))
        options.html.write_text(text, encoding="utf-8", errors="replace")
    if options.wire_logs is not None:
        report.write_wire_logs(results, options.wire_logs)

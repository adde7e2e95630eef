"""Report of a run as one self-contained HTML page: no scripts, and no external fonts or pictures."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from importlib import resources

from armgate.conformance.case import Outcome
from armgate.conformance.report import skip_reasons, tally
from armgate.conformance.runner import Result
from armgate.conformance.target import ServerInfo


def html_page(results: Sequence[Result], server: ServerInfo, where: str, strict: bool, arguments: str) -> str:
    """Return the HTML page.

    Args:
        results: All results of the run.
        server: Welcome and cell of the server.
        where: Its address.
        strict: True if a violated SHOULD counts as failed.
        arguments: The command line of the kit.
    """
    style = resources.files(__package__).joinpath("html_report.css").read_text(encoding="utf-8")
    when = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    software = escape(str(server.welcome.get("software") or "a server"))
    versions = ", ".join(map(str, server.welcome["versions"]))
    mode = "in lock-step" if server.lockstep else "by the wall clock"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Conformance of {escape(where)}</title><style>{style}</style></head><body><main>"
        f"<h1>Protocol conformance</h1><p>{software} at <code>{escape(where)}</code>, versions {versions}, "
        f"{mode}, cell <code>{escape(server.description['name'])}</code>, robot "
        f"<code>{escape(server.robot['name'])}</code></p>"
        f'<p class="faint">{when} · <code>{escape(arguments)}</code></p>'
        f"{_summary(results, strict)}{_sections(results)}</main></body></html>\n"
    )


def _summary(results: Sequence[Result], strict: bool) -> str:
    passed, failed, skipped = tally(results, strict)
    unsafe = sum(result.safety is Outcome.FAIL for result in results)
    soft = sum(result.outcome is Outcome.NON_STRICT for result in results)
    parts = [(passed, "pass"), (failed, "fail"), (skipped, "skip")]
    bar = "".join(f'<i style="flex:{count};background:var(--{name})"></i>' for count, name in parts if count)
    seconds = sum(result.seconds for result in results)
    skips = "".join(f'<p class="faint">{escape(reason)}</p>' for reason in skip_reasons(results))
    return (
        f'<div class="bar">{bar}</div><div class="tally"><span><b>{len(results)}</b> cases</span>'
        f"<span><b>{passed}</b> passed</span><span><b>{failed}</b> failed</span><span><b>{skipped}</b> "
        f"skipped</span>"
        f"<span><b>{unsafe}</b> unsafe</span><span><b>{soft}</b> non-strict</span>"
        f"<span><b>{seconds:.0f}</b> s</span></div>{skips}"
    )


def _sections(results: Sequence[Result]) -> str:
    sections: dict[str, list[Result]] = {}
    for result in results:
        sections.setdefault(result.case.statement.section, []).append(result)
    head = (
        '<div class="head"><span>safety</span><span>session</span><span>case</span><span>description</span>'
        '<span class="sec">s</span></div>'
    )
    return "".join(
        f"<h2>{escape(title)} <small>{sum(r.outcome is Outcome.PASS for r in members)} of {len(members)} "
        f"passed"
        f'</small></h2><div class="table">{head}{"".join(map(_case, members))}</div>'
        for title, members in sections.items()
    )


def _case(result: Result) -> str:
    case = result.case
    wrong = result.outcome in (Outcome.FAIL, Outcome.NON_STRICT)
    found = "".join(
        f'<p class="{"found" if wrong else "faint"}">{escape(text)}</p>' for text in result.findings
    )
    wire = f"<pre>{escape(chr(10).join(result.wire))}</pre>" if result.wire else ""
    also = ", ".join(case.also)
    further = f"<dt>also tests</dt><dd>{escape(also)}</dd>" if also else ""
    return (
        f"<details{' open' if wrong else ''}><summary>{_badge(result.safety)}{_badge(result.session)}"
        f"<span><code>{escape(case.id)}</code></span><span>{escape(case.description)}</span><span "
        f'class="sec">'
        f'{result.seconds:.2f}</span></summary><div class="body"><dl><dt>expectation</dt><dd>'
        f"{escape(case.expectation)}"
        f"</dd><dt>{escape(case.statement.id)}</dt><dd><blockquote>{_marked(case.statement.text)}</blockquote></dd>"
        f"{further}</dl>{found}{wire}</div></details>"
    )


def _marked(text: str) -> str:
    """Return a sentence of the specification as HTML, with its `code` marked up."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(text))


def _badge(outcome: Outcome) -> str:
    return f'<span><span class="v {outcome.value}">{outcome.value}</span></span>'

"""Reports of a run: lines for the terminal, JUnit XML, and wire logs of failures."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from armgate.conformance.case import Outcome
from armgate.conformance.runner import Result

_TAIL = 12
"""Records of the wire log that are printed for each failure."""


def tally(results: Sequence[Result], strict: bool) -> tuple[int, int, int]:
    """Return how many cases passed, failed and were skipped."""
    failed = sum(result.failed(strict) for result in results)
    skipped = sum(result.outcome is Outcome.SKIPPED for result in results)
    return len(results) - failed - skipped, failed, skipped


def last_line(results: Sequence[Result], strict: bool) -> str:
    """Return the line ``N cases, N passed, N failed, N skipped``."""
    passed, failed, skipped = tally(results, strict)
    return f"{len(results)} cases, {passed} passed, {failed} failed, {skipped} skipped"


def line(result: Result) -> str:
    """Return one line for one case."""
    outcomes = f"{result.safety.value:<10} {result.session.value:<10}"
    return f"{outcomes} {result.case.id:<28} {result.seconds:6.2f} s  {result.case.description}"


def failure(result: Result) -> str:
    """Return the lines of a case that did not pass: statement, expectation, findings, end of the wire log."""
    case = result.case
    lines = [
        f"    {case.statement.id}: {case.statement.text}",
        f"    expected: {case.expectation}",
        *(f"    {finding}" for finding in result.findings),
    ]
    if result.wire:
        lines += [
            "    end of the wire log:",
            *(f"      {part}" for entry in result.wire[-_TAIL:] for part in entry.splitlines()),
        ]
    return "\n".join(lines)


def skip_reasons(results: Sequence[Result]) -> list[str]:
    """Return the reasons why cases were skipped, each once, with the number of cases."""
    counted = Counter(
        r.findings[0].removeprefix("session: ") for r in results if r.outcome is Outcome.SKIPPED
    )
    return [f"{number} skipped: {reason}" for reason, number in counted.most_common()]


def write_wire_logs(results: Sequence[Result], folder: Path) -> None:
    """Write the wire log of each case that did not pass into a file of its own."""
    for result in results:
        if result.wire:
            head = [f"{result.case.id}: {result.case.description}", *result.findings, ""]
            name = result.case.id.replace("/", "_") + ".txt"
            (folder / name).write_text(
                "\n".join([*head, *result.wire]) + "\n", encoding="utf-8", errors="replace"
            )


def write_junit(results: Sequence[Result], file: Path, strict: bool) -> None:
    """Write a JUnit XML report, with one suite for each section of the specification."""
    _, failed, skipped = tally(results, strict)
    seconds = sum(result.seconds for result in results)
    root = ET.Element(
        "testsuites",
        name="armgate conformance",
        tests=str(len(results)),
        failures=str(failed),
        skipped=str(skipped),
        time=f"{seconds:.3f}",
    )
    sections: dict[str, list[Result]] = {}
    for result in results:
        sections.setdefault(result.case.statement.section, []).append(result)
    for section, members in sections.items():
        _suite(root, section, members, strict)
    ET.indent(root)
    ET.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)


def _suite(root: ET.Element, section: str, members: Sequence[Result], strict: bool) -> None:
    _, failed, skipped = tally(members, strict)
    suite = ET.SubElement(
        root,
        "testsuite",
        name=section,
        tests=str(len(members)),
        failures=str(failed),
        skipped=str(skipped),
        time=f"{sum(result.seconds for result in members):.3f}",
    )
    for result in members:
        name = f"{result.case.id} {result.case.description}"
        element = ET.SubElement(
            suite, "testcase", classname=section, name=_legal(name), time=f"{result.seconds:.3f}"
        )
        findings = _legal("\n".join(result.findings))
        if result.failed(strict):
            outcomes = f"safety {result.safety.value}, session {result.session.value}"
            ET.SubElement(element, "failure", message=outcomes).text = findings
            ET.SubElement(element, "system-out").text = _legal("\n".join(result.wire))
        elif result.outcome is Outcome.SKIPPED:
            ET.SubElement(element, "skipped", message=findings)
        elif result.findings:
            ET.SubElement(element, "system-out").text = findings


def _legal(text: str) -> str:
    """Replace the characters that XML does not allow."""
    return "".join(
        c if c in "\n\t" or (c >= " " and not "\ud800" <= c <= "\udfff" and c not in "\ufffe\uffff") else "�"
        for c in text
    )

"""Commands in documents, workflows and help exist: make targets, armgate's commands and their options."""

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from tools.reference.cli import command_line

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").glob("*.md"))]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
TARGETS = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
FENCED = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`([^`\n]+)`")
INDENTED = re.compile(r"^ {4}((?:\.venv/bin/)?armgate [a-z-]+ .*|make .*)$", re.MULTILINE)
PLACEHOLDER = re.compile(r"[…<>|\[\]{}]")


def lines_of_code(path: Path) -> Iterator[str]:
    text = path.read_text(encoding="utf-8")
    for language, block in FENCED.findall(text):
        if language in {"", "sh", "text"}:
            yield from block.splitlines()
    prose = FENCED.sub("", text)
    yield from INLINE.findall(prose)
    yield from (line for line in INDENTED.findall(prose) if "armgate is " not in line)


def options() -> dict[str, set[str]]:
    """Return the options of every command, from the reference."""
    sections = re.split(r"^## armgate ", command_line(), flags=re.MULTILINE)[1:]
    rows = {part.splitlines()[0]: re.findall(r"`(--[a-z-]+)`", part) for part in sections}
    return {name: {*found, "--help"} for name, found in rows.items()}


OPTIONS = options()
EXAMPLES = {"home"}
"""Commands that a page implements as examples."""
GROUPS = {name.split()[0] for name in OPTIONS if " " in name}


def unknown(line: str) -> str | None:
    """Return what a command line names that does not exist, or None."""
    words = shlex.split(line, comments=True)
    while words and ("=" in words[0] or words[0] in {"sudo", "timeout"}):
        words.pop(0)
    if not words or words[0] not in {"armgate", ".venv/bin/armgate"} or len(words) == 1:
        return None
    name = " ".join(words[1:3]) if words[1] in GROUPS else words[1]
    if words[1].startswith("-") or PLACEHOLDER.search(name) or name.isupper() or name in GROUPS:
        return None
    if name in EXAMPLES:
        return None
    if name not in OPTIONS:
        return f"armgate {name}"
    given = {word.partition("=")[0] for word in words[2:] if re.match(r"--[a-z]", word)}
    wrong = {
        word
        for word in given
        if word not in OPTIONS[name] and word.replace("--no-", "--") not in OPTIONS[name]
    }
    return f"armgate {name} {' '.join(sorted(wrong))}" if wrong else None


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_commands_in_a_document_exist(path: Path) -> None:
    found = []
    for line in lines_of_code(path):
        for target in re.findall(r"(?:^|\s)make ((?:[a-z][a-z-]+ ?)+)", line):
            found += [f"make {name}" for name in target.split() if name not in TARGETS]
        for part in re.split(r"&&|[|;]", line):
            try:
                missing = unknown(part)
            except ValueError:  # an apostrophe in a line that is not a command
                continue
            found += [missing] if missing else []
    assert found == []


@pytest.mark.parametrize(
    "line", ["armgate nothing x", "armgate serve a.yaml --nothing", "armgate rsi nothing"]
)
def test_a_command_that_does_not_exist_is_found(line: str) -> None:
    assert unknown(line)


def test_the_two_commands_of_the_readme_run_the_demo_and_the_tests() -> None:
    for target, expected in (("demo", "armgate demo"), ("test", "-m pytest")):
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True)
        assert expected in done.stdout


def test_every_target_is_listed_by_make() -> None:
    listed = set(re.findall(r"^([a-z-]+):.*## ", MAKEFILE, re.MULTILINE))
    assert TARGETS - listed == set()
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert set(phony.split()) == listed


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_is_pinned_and_its_commands_exist(path: Path) -> None:
    jobs = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    for job in jobs.values():
        assert job["timeout-minutes"] > 0
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step)
            if "uses" in step:
                assert re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", step["uses"])
            for targets in re.findall(r"make ((?:[a-z][a-z-]+ ?)+)", step.get("run", "")):
                assert set(targets.split()) <= TARGETS


def test_the_workflows_cover_lint_tests_docs_and_the_wheel() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))["jobs"]
    assert set(jobs) == {"lint", "test", "docs", "wheel"}
    for name in ("test", "wheel"):
        assert jobs[name]["strategy"]["matrix"]["python"] == ["3.11", "3.12", "3.13"]


@pytest.mark.parametrize("path", [p for p in FORMS if p.stem != "config"], ids=lambda path: path.stem)
def test_an_issue_form_has_fields_with_unique_ids(path: Path) -> None:
    form = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= set(form)
    ids = [field["id"] for field in form["body"] if field["type"] != "markdown"]
    assert ids
    assert len(set(ids)) == len(ids)

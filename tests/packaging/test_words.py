"""The lint of English finds bare clauses, idioms and long sentences, and passes plain sentences."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools.words.idioms import IDIOMS, idioms
from tools.words.markdown import LONGEST, markdown_findings
from tools.words.python import OPENINGS, python_findings

ROOT = Path(__file__).resolve().parents[2]


def kinds(findings: object) -> list[str]:
    return [finding.kind for finding in findings]  # type: ignore[attr-defined]


@pytest.mark.parametrize("opening", OPENINGS)
def test_a_docstring_that_begins_with_a_bare_clause_is_found(opening: str) -> None:
    source = f'def f():\n    """{opening} it moves."""\n\nlimit = 1\n"""{opening} it moves."""\n'
    found = sorted(python_findings(source))
    assert [(f.line, f.kind) for f in found] == [(2, "docstring"), (5, "docstring")]


@pytest.mark.parametrize(
    "line",
    [
        "Return True if it moves.",
        "Whole stop path.",
        "Assembly of a body.",
        "``what`` of a request.",
        "Howitzer.",
    ],
)
def test_a_verb_or_a_noun_phrase_is_no_finding(line: str) -> None:
    assert [*python_findings(f'def f():\n    """{line}"""\n')] == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Nobody holds the robot", "nobody"),
        ("an error that is none", "is none"),
        ("the daemon tells the client", "tells"),
        ("what the pointer let go", "let go"),
        ("a token that is no more", "is no more"),
        ("robots on loopback neither.", "neither"),
        ("make it whole", None),
        ("no more than 3 mm", None),
        ("cannot be told apart", None),
        ("tell noise from motion", None),
        ("there is none", None),
        ("if step is None", None),
    ],
)
def test_idioms_are_found_without_false_alarms(text: str, found: str | None) -> None:
    descriptions = [description for _, description in idioms(text)]
    assert [d.split("”")[0].strip("“") for d in descriptions] == ([found] if found else [])


def test_each_idiom_has_a_hint() -> None:
    assert all(hint for hint in IDIOMS.values())


def test_comments_and_texts_are_searched_and_code_is_not() -> None:
    source = 'x = "nobody"  # nobody is here\ny = f"told {x} off"\n"""``nobody`` is a user."""\n'
    assert [(f.line, f.kind) for f in python_findings(source)] == [(1, "idiom"), (2, "idiom")]


def test_names_of_functions_are_searched() -> None:
    source = "class A:\n    def _hear(self): ...\n    def hearing(self): ...\ndef test_whoever_it_is(): ...\n"
    assert sorted((f.line, f.kind) for f in python_findings(source)) == [(2, "name"), (4, "name")]


def test_long_sentences_are_found_in_paragraphs_items_and_cells() -> None:
    long, short = ("word " * (LONGEST + 1)).strip(), ("word " * LONGEST).strip()
    assert kinds(markdown_findings(f"{long}.\n\n- {long}.\n\n| a | {long} |\n")) == ["long sentence"] * 3
    assert kinds(markdown_findings(f"{short}. {short}\n\n- {short}\n- {short}\n")) == []


def test_code_in_markdown_is_not_searched() -> None:
    assert (
        kinds(markdown_findings("```sh\nnobody\n```\n\n    nobody\n\nuser `nobody` and <!-- nobody -->\n"))
        == []
    )


def test_findings_keep_their_line() -> None:
    assert [f.line for f in markdown_findings("# One\n\n```\n\n```\n\nPlain.\n\nNobody is here.\n")] == [9]


def test_the_command_prints_findings_and_counts_by_folder(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Nobody is here.\n", encoding="utf-8")
    command = [sys.executable, "-m", "tools.words", str(page)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"{page}:1: idiom: “nobody”" in done.stdout
    page.write_text("The robot rests.\n", encoding="utf-8")
    assert subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode == 0
    page.unlink()
    assert subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode == 2

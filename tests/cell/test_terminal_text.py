"""Tests of the escaping of texts before they are shown."""

import sys
import unicodedata

import pytest

from armgate.cell.terminal_text import printable, printable_lines


@pytest.mark.parametrize("text", ["", "plain", "A1 – 30°, δ ρ ×, 5 mm²", "ロボット", "naïve 𝕏", "\\n"])
def test_visible_text_is_unchanged(text):
    assert printable(text) == text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("\x1b[2J\x1b]0;title\x07", "\\x1b[2J\\x1b]0;title\\x07"),
        ("one\ntwo\r\tthree", "one\\ntwo\\r\\tthree"),
        ("\x9b31m\x7f\x00", "\\x9b31m\\x7f\\x00"),
        ("a\u202eb\u2066c\u200fd", "a\\u202eb\\u2066c\\u200fd"),
        ("a\u200bb\ufeffc\u2028d\u2029e\xad", "a\\u200bb\\ufeffc\\u2028d\\u2029e\\xad"),
        ("\ud800 \U000e0041 \ue000", "\\ud800 \\U000e0041 \\ue000"),
    ],
)
def test_control_and_invisible_characters_are_escaped(text, shown):
    assert printable(text) == shown


def test_no_character_of_unicode_controls_a_terminal():
    shown = printable("".join(map(chr, (*range(0x10000), *range(0xE0000, 0xE1000), sys.maxunicode))))
    assert {unicodedata.category(c) for c in shown} & {"Cc", "Cf", "Cs", "Zl", "Zp"} == set()
    shown.encode()


def test_printable_lines_keeps_line_breaks():
    assert printable_lines("one\n\x1btwo") == "one\n\\x1btwo"

"""Agreement of the specification with the code: tables, bounds, causes, errors."""

import re

import pytest

from armgate.events import Cause
from armgate.protocol import CODES, HANDSHAKE_LIMIT, INBOUND_LIMIT, OUTBOUND_LIMIT, codec
from armgate.protocol import messages as m
from armgate.protocol.spec_statements import spec_text, statements
from tools.spec.__main__ import main, products
from tools.spec.tables import BLOCKS, filled

SPEC = spec_text()
WHOLE = {key: statement.text for key, statement in statements().items()}


def test_the_generated_files_are_up_to_date(capsys):
    assert main(["--check"]) == 0, capsys.readouterr().err
    assert all(path.exists() for path in products())


def test_check_reports_a_difference_and_a_wrong_option(tmp_path, monkeypatch, capsys):
    file = tmp_path / "drawn" / "x.md"
    monkeypatch.setattr("tools.spec.__main__.products", lambda: {file: "drawn"})
    assert main(["--check"]) == 1
    assert "make spec" in capsys.readouterr().err
    assert not file.exists()
    assert main([]) == 0
    assert file.read_text() == "drawn"
    assert main(["--check"]) == 0
    assert main(["--chekc"]) == 2


def test_only_the_blocks_are_replaced():
    text = "a\n<!-- begin x -->\nold\n<!-- end -->\nb\n"
    assert filled(text, {"x": lambda: "new"}) == text.replace("old", "new")
    for blocks in ({}, {"x": str, "y": str}):
        with pytest.raises(ValueError, match="blocks"):
            filled(text, blocks)
    with pytest.raises(ValueError, match="blocks"):
        filled(text + text, {"x": str})


def test_every_message_field_and_code_is_in_the_tables():
    for message in (*m.CLIENT_MESSAGES, *m.SERVER_MESSAGES):
        assert f"**`{message.model_fields['type'].default}`**" in SPEC
        for name in message.model_fields.keys() - {"type"}:
            assert f"|  | `{name}` | " in SPEC
    assert "| `signal` | `signaled` |" in BLOCKS["answers"]()
    assert [line.split("`")[1] for line in BLOCKS["errors"]().splitlines()[2:]] == list(CODES)


def test_a_field_without_a_docstring_is_an_error(monkeypatch):
    monkeypatch.setattr("tools.spec.tables._field_docstrings", dict)
    with pytest.raises(ValueError, match=r"Hello\.id has no docstring"):
        BLOCKS["client"]()


def test_every_request_has_an_answer():
    requests = [message for message in m.CLIENT_MESSAGES if issubclass(message, m.Request)]
    assert list(m.ANSWERS) == requests
    assert set(m.ANSWERS.values()) <= set(m.SERVER_MESSAGES)


def test_the_diagrams_contain_every_transition():
    drawn = BLOCKS["lease"]()
    assert "held --> free: release / expire / drop" in drawn
    assert "ready --> ready: client: any other message / server: any other message" in BLOCKS["connection"]()


def test_the_checks_are_stated_in_the_order_of_the_causes():
    stated = [re.search("with cause `([a-z_]+)`", WHOLE[f"CMD-{n}"])[1] for n in range(8, 17)]
    stated += re.findall("`([a-z_]+)`", WHOLE["CMD-19"])
    order = [cause.value for cause in Cause]
    assert sorted(stated, key=order.index) == order
    # A tick cannot be both ahead and stale, so the order of these two checks does not matter.
    assert [cause for cause in stated if cause != "ahead"] == [cause for cause in order if cause != "ahead"]


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("FRM-3", f"longer than {HANDSHAKE_LIMIT} bytes before"),
        ("FRM-3", f"longer than {INBOUND_LIMIT:,} bytes after"),
        ("FRM-4", f"longer than {OUTBOUND_LIMIT:,} bytes"),
        ("FRM-5", f"a payload of {HANDSHAKE_LIMIT} bytes"),
        ("FRM-6", f"a payload of {INBOUND_LIMIT:,} bytes"),
        ("PAY-5", f"nested {codec.MAX_DEPTH} deep"),
        ("PAY-6", f"maps of {codec.MAX_MAP} keys"),
        ("PAY-7", f"arrays of {codec.MAX_ARRAY_INBOUND} items"),
        ("PAY-8", f"texts of {codec.MAX_STR} bytes"),
        ("PAY-11", f"up to {codec.MAX_ARRAY} items"),
        ("PAY-11", f"{m.MAX_CHUNK:,} bytes"),
        ("HEL-12", f"`inbound` {INBOUND_LIMIT:,} and `outbound` {OUTBOUND_LIMIT:,}"),
        ("SIG-5", f"more than {m.MAX_SIGNAL}"),
    ],
)
def test_the_limits_in_statements_are_those_of_the_code(key, text):
    assert text in WHOLE[key]


def test_every_code_in_a_statement_is_in_the_table():
    types = {model.model_fields["type"].default for model in (*m.CLIENT_MESSAGES, *m.SERVER_MESSAGES)}
    named = {
        code
        for text in WHOLE.values()
        for code in re.findall(r"(?:\bfatal|\bfail with|answer[^.;]* with(?: an?)?) `([a-z_]+)`", text)
    }
    assert named <= set(CODES) | types
    assert len(named & set(CODES)) > 20, "the statements name codes in other words now"

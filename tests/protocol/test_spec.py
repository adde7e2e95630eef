"""The tables of the specification are those of the code."""

import re
from pathlib import Path

import pytest

import armgate.protocol
from armgate.cell.events import Cause
from armgate.protocol import (
    CODES,
    HANDSHAKE_LIMIT,
    INBOUND_LIMIT,
    OUTBOUND_LIMIT,
    Side,
    codec,
    connection,
    lease,
)
from armgate.protocol import messages as m

SPEC = (Path(armgate.protocol.__file__).parent / "SPEC.md").read_text(encoding="utf-8")


def section(number):
    """The text of one section."""
    return re.split(r"^## (?=\d)", SPEC, flags=re.MULTILINE)[number]


def rows(text):
    """The rows of all tables in a text, without their heads."""
    found = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"
    ]
    return [row for row in found if not re.fullmatch(r"-+", row[0])]


def fields(model):
    names = [(name, field) for name, field in model.model_fields.items() if name != "type"]
    return ", ".join(f"`{name}`" if field.is_required() else f"`{name}`?" for name, field in names) or "–"


@pytest.mark.parametrize(("number", "models"), [(3, m.CLIENT_MESSAGES), (4, m.SERVER_MESSAGES)])
def test_messages_and_their_fields(number, models):
    told = [row[:2] for row in rows(section(number)) if row[0].startswith("`")]
    assert told == [[f"`{model.model_fields['type'].default}`", fields(model)] for model in models]


def test_maps_inside_messages():
    parts = [x for x in vars(m).values() if isinstance(x, type) and issubclass(x, m.Part) and x is not m.Part]
    table = rows(section(4).partition("Maps inside messages")[2])[1:]
    assert table == [[part.__name__, fields(part)] for part in parts]


def test_the_connection():
    told = {}
    for state, client, server, following in rows(section(5))[1:]:
        side, cell, says = (
            (Side.CLIENT, client, m.CLIENT_MESSAGES) if client else (Side.SERVER, server, m.SERVER_MESSAGES)
        )
        events = set(re.findall("`([a-z]+)`", cell.replace("a fatal `error`", "`fatal`")))
        if "any other message" in cell:
            events |= {model.model_fields["type"].default for model in says} - {"hello", "welcome", "bye"}
        told |= {(state, side, event): following for event in events}
    assert told == {(s.value, side, e): after.value for (s, side, e), after in connection.TRANSITIONS.items()}


def test_leases():
    told = {(state, event): after for state, event, after in rows(section(6))[1:]}
    assert told == {(s.value, e.value): after.value for (s, e), after in lease.TRANSITIONS.items()}


def test_error_codes():
    expected = [
        [f"`{code.value}`", "yes" if row.fatal else "no", row.meaning, row.advice]
        for code, row in CODES.items()
    ]
    assert rows(section(11))[1:] == expected


def test_the_order_of_checks_is_that_of_the_causes():
    told = re.findall("`([a-z_]+)`", section(7).partition("**7.4**")[2].partition("**7.6**")[0])
    causes = [name for name in told if name in set(Cause)]
    order = [cause.value for cause in Cause]
    assert sorted(causes, key=order.index) == sorted(order, key=order.index)
    assert [c for c in causes if c not in ("ahead", "stale")] == [
        c for c in order if c not in ("ahead", "stale")
    ]


def test_limits():
    assert (HANDSHAKE_LIMIT, INBOUND_LIMIT, OUTBOUND_LIMIT) == (4 * 1024, 64 * 1024, 1024 * 1024)
    framing = " ".join(section(1).split())
    assert (
        "4 KiB towards the server before its welcome, 64 KiB towards the server after it, 1 MiB towards"
        in framing
    )
    payloads = " ".join(section(2).split())
    for text in (
        f"nesting {codec.MAX_DEPTH} deep",
        f"{codec.MAX_MAP} keys a map",
        f"{codec.MAX_ARRAY_INBOUND} items an array towards the server, {codec.MAX_ARRAY} towards the client",
        f"{codec.MAX_STR} bytes a text",
        f"{m.MAX_CHUNK // 1024} KiB of binary data",
    ):
        assert text in payloads

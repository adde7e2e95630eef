"""The statements of the specification are read as they stand there."""

import re
from collections import Counter

import pytest

from armgate.protocol.statements import (
    Binds,
    Level,
    SpecError,
    Statement,
    When,
    parse,
    spec_text,
    statements,
)


def test_every_item_that_looks_like_one_is_read():
    assert len(statements()) == len(re.findall(r"^- \*\*", spec_text(), re.MULTILINE))
    assert len(statements()) > 200


def test_a_statement_over_two_lines():
    text = "## 7. Leases\n\n- **LEA-7** (server, lock-step): A server SHOULD,\n  MAY and so on.\n\nText.\n"
    assert parse(text) == {
        "LEA-7": Statement(
            "LEA-7", "7. Leases", Binds.SERVER, When.LOCKSTEP, Level.SHOULD, "A server SHOULD, MAY and so on."
        )
    }


@pytest.mark.parametrize(
    ("item", "problem"),
    [
        ("- **LEA7** (server): A MUST.", "like LEA-7"),
        ("- **LEA-07** (server): A MUST.", "like LEA-7"),
        ("- **LEA-7** server: A MUST.", "whom, when"),
        ("- **LEA-7** (server): A MUST", "sentence"),
        ("- **LEA-7** (server): A must.", "MUST, SHOULD or MAY"),
        ("- **LEA-7** (sever): A MUST.", "sever"),
        ("- **LEA-7** (server, always-not): A MUST.", "always-not"),
        ("- **LEA-7** (server): A MUST.\n- **LEA-7** (server): B MUST.", "twice"),
    ],
)
def test_a_statement_without_its_form(item, problem):
    with pytest.raises(SpecError, match=problem):
        parse(f"## 7. Leases\n{item}\n")


def test_ids_are_counted_up_within_their_letters():
    groups = Counter(key.partition("-")[0] for key in statements())
    numbers = {group: [] for group in groups}
    for key in statements():
        group, _, number = key.partition("-")
        numbers[group].append(int(number))
    for group, found in numbers.items():
        assert found == sorted(found), group


def test_who_can_be_tried_from_outside():
    assert statements()["FRM-1"].about_server
    assert statements()["FRM-4"].about_server
    assert not statements()["FRM-3"].about_server
    assert not statements()["SEC-1"].about_server

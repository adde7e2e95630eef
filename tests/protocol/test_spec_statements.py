"""Parser of the specification's statements."""

import re
from collections import Counter

import pytest

from armgate.protocol.spec_statements import (
    Binds,
    Level,
    SpecError,
    Statement,
    When,
    parse,
    spec_text,
    statements,
)


def test_every_item_of_the_text_is_parsed():
    assert len(statements()) == len(re.findall(r"^- \*\*", spec_text(), re.MULTILINE))
    assert len(statements()) > 200


def test_a_statement_may_span_lines():
    text = "## 7. Leases\n\n- **LEA-7** (server, lock-step): A server SHOULD,\n  MAY and so on.\n\nText.\n"
    assert parse(text) == {
        "LEA-7": Statement(
            "LEA-7", "7. Leases", Binds.SERVER, When.LOCKSTEP, Level.SHOULD, "A server SHOULD, MAY and so on."
        )
    }


@pytest.mark.parametrize(
    ("item", "problem"),
    [
        ("- **LEA7** (server): A MUST.", "such as LEA-7"),
        ("- **LEA-07** (server): A MUST.", "such as LEA-7"),
        ("- **LEA-7** server: A MUST.", "party, condition"),
        ("- **LEA-7** (server): A MUST", "sentence"),
        ("- **LEA-7** (server): A must.", "MUST, SHOULD or MAY"),
        ("- **LEA-7** (sever): A MUST.", "sever"),
        ("- **LEA-7** (server, always-not): A MUST.", "always-not"),
        ("- **LEA-7** (server): A MUST.\n- **LEA-7** (server): B MUST.", "twice"),
    ],
)
def test_a_malformed_statement_is_an_error(item, problem):
    with pytest.raises(SpecError, match=problem):
        parse(f"## 7. Leases\n{item}\n")


def test_ids_increase_within_their_group():
    groups = Counter(key.partition("-")[0] for key in statements())
    numbers = {group: [] for group in groups}
    for key in statements():
        group, _, number = key.partition("-")
        numbers[group].append(int(number))
    for group, found in numbers.items():
        assert found == sorted(found), group


def test_statements_that_a_client_can_check_are_known():
    assert statements()["FRM-1"].about_server
    assert statements()["FRM-4"].about_server
    assert not statements()["FRM-3"].about_server
    assert not statements()["SEC-1"].about_server

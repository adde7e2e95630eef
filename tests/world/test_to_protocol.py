"""Messages keep the protocol's bounds, whatever gate and daemon report."""

import pytest

from armgate.events import Cause, Reason
from armgate.protocol import messages as m
from armgate.world import to_protocol


def reason(cause, number, text="why"):
    return Reason(cause, f"{text} {number}", joint=f"j{number}")


@pytest.mark.parametrize("count", [0, 1, m.MAX_REASONS])
def test_reasons_that_fit_are_all_sent(count):
    given = [reason(Cause.INCREMENT, number) for number in range(count)]
    assert [one.text for one in to_protocol.reasons(given)] == [one.text for one in given]


def test_of_too_many_reasons_each_cause_is_sent_and_the_others_are_counted():
    given = [reason(Cause.INCREMENT, n) for n in range(64)]
    given += [reason(Cause.ACCELERATION, n) for n in range(64)] + [
        reason(Cause.JOINT_LIMIT, n) for n in range(64)
    ]
    given += [reason(Cause.CLEARANCE, 0)]
    told = to_protocol.reasons(given)
    assert len(told) == m.MAX_REASONS
    assert {one.cause for one in told} == {"increment", "acceleration", "joint_limit", "clearance"}
    assert told[0].text == "why 0"
    assert told[-1].cause == "clearance"  # the state counts a verdict under the cause of its last reason
    assert told[-1].text == f"why 0 (and {len(given) - m.MAX_REASONS} more reasons)"


def test_the_count_of_omitted_reasons_fits_after_the_longest_text():
    given = [reason(Cause.INCREMENT, n, "x" * m.MAX_TEXT) for n in range(100)]
    last = to_protocol.reasons(given)[-1].text
    assert len(last) == m.MAX_TEXT
    assert last.endswith("x… (and 36 more reasons)")


def test_stops_are_the_newest_and_warnings_are_counted():
    assert to_protocol.stops(range(100)) == tuple(range(36, 100))
    told = to_protocol.warnings(f"w{number}" + "x" * 600 for number in range(20))
    assert len(told) == m.MAX_WARNINGS
    assert all(len(one) <= m.MAX_TEXT for one in told)
    assert told[-1].endswith("(and 4 more warnings)")
    assert to_protocol.warnings(["one"]) == ("one",)

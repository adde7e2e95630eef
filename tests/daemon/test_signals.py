"""Signals: one owner each, bounded in number and rate."""

import pytest

from armgate.daemon.signals import Signals
from armgate.protocol import RemoteProtocolError


def code_of(signals, *arguments):
    with pytest.raises(RemoteProtocolError) as caught:
        signals.set(*arguments)
    assert not caught.value.fatal
    return caught.value.code.value


def test_values_are_kept_by_name_with_their_owner():
    signals = Signals(200.0)
    signals.set("s2", "zoom", "operator.distance", (1.5,), 0.1)
    signals.set("s1", "leader", "lead.progress", (0.2,), 0.2)
    signals.set("s1", "leader", "lead.progress", (0.3,), 0.3)
    assert list(signals.values) == ["lead.progress", "operator.distance"]
    value = signals.values["lead.progress"]
    assert (value.owner, value.value, value.time) == ("leader", (0.3,), 0.3)


def test_a_signal_has_one_owner_until_its_session_ends():
    signals = Signals(200.0)
    signals.set("s1", "leader", "x", (1.0,), 0.0)
    assert code_of(signals, "s2", "other", "x", (2.0,), 0.0) == "signal_owned"
    signals.drop("s1")
    assert signals.values == {}
    signals.set("s2", "other", "x", (2.0,), 0.0)
    assert signals.values["x"].owner == "other"


def test_values_handed_out_do_not_change():
    signals = Signals(200.0)
    signals.set("s1", "leader", "x", (1.0,), 0.0)
    before = signals.values
    signals.set("s1", "leader", "y", (2.0,), 0.0)
    signals.drop("s1")
    assert list(before) == ["x"]


def test_too_many_names_are_refused_and_the_known_ones_still_taken():
    signals = Signals(1000.0, limit=3)
    for number in range(3):
        signals.set("s1", "a", f"x{number}", (0.0,), 0.0)
    assert code_of(signals, "s1", "a", "x3", (0.0,), 0.0) == "too_many_signals"
    signals.set("s1", "a", "x2", (1.0,), 0.0)


def test_a_session_that_sends_too_fast_is_throttled_and_others_are_not():
    signals = Signals(rate=10.0)
    for _ in range(10):
        signals.set("s1", "a", "x", (0.0,), 5.0)
    assert code_of(signals, "s1", "a", "x", (0.0,), 5.0) == "signal_rate"
    signals.set("s2", "b", "y", (0.0,), 5.0)
    signals.set("s1", "a", "x", (0.0,), 5.11)
    assert code_of(signals, "s1", "a", "x", (0.0,), 5.12) == "signal_rate"
    for _ in range(10):
        signals.set("s1", "a", "x", (0.0,), 100.0)  # no more than one second's worth is saved up
    assert code_of(signals, "s1", "a", "x", (0.0,), 100.0) == "signal_rate"

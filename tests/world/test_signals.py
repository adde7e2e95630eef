"""Signals: one owner each, bounded in number and rate."""

import pytest

from armgate.cell.errors import ConfigError
from armgate.protocol import RemoteProtocolError
from armgate.world.interfaces import Client
from armgate.world.signals import KEPT, Reserved, Signals
from support.cells import arms_config


def code_of(signals, *arguments):
    with pytest.raises(RemoteProtocolError) as caught:
        signals.set(*arguments)
    assert not caught.value.fatal
    return caught.value.code.value


def test_values_are_kept_by_name_with_their_owner():
    signals = Signals(200.0)
    signals.set(Client("s2", "zoom", "controller"), "operator.distance", (1.5,), 0.1)
    signals.set(Client("s1", "leader", "controller"), "lead.progress", (0.2,), 0.2)
    signals.set(Client("s1", "leader", "controller"), "lead.progress", (0.3,), 0.3)
    assert list(signals.values) == ["lead.progress", "operator.distance"]
    value = signals.values["lead.progress"]
    assert (value.owner, value.value, value.time) == ("leader", (0.3,), 0.3)


def test_a_signal_has_one_owner_until_its_session_ends():
    signals = Signals(200.0)
    signals.set(Client("s1", "leader", "controller"), "x", (1.0,), 0.0)
    assert code_of(signals, Client("s2", "other", "controller"), "x", (2.0,), 0.0) == "signal_owned"
    signals.drop("s1")
    assert signals.values == {}
    signals.set(Client("s2", "other", "controller"), "x", (2.0,), 0.0)
    assert signals.values["x"].owner == "other"


def test_values_handed_out_do_not_change():
    signals = Signals(200.0)
    signals.set(Client("s1", "leader", "controller"), "x", (1.0,), 0.0)
    before = signals.values
    signals.set(Client("s1", "leader", "controller"), "y", (2.0,), 0.0)
    signals.drop("s1")
    assert list(before) == ["x"]


def test_too_many_names_are_refused_and_known_ones_still_accepted():
    signals = Signals(1000.0, limit=3)
    for number in range(3):
        signals.set(Client("s1", "a", "controller"), f"x{number}", (0.0,), 0.0)
    assert code_of(signals, Client("s1", "a", "controller"), "x3", (0.0,), 0.0) == "too_many_signals"
    signals.set(Client("s1", "a", "controller"), "x2", (1.0,), 0.0)


def test_a_session_that_sends_too_fast_is_throttled_and_others_are_not():
    signals = Signals(rate=10.0)
    for _ in range(10):
        signals.set(Client("s1", "a", "controller"), "x", (0.0,), 5.0)
    assert code_of(signals, Client("s1", "a", "controller"), "x", (0.0,), 5.0) == "signal_rate"
    signals.set(Client("s2", "b", "controller"), "y", (0.0,), 5.0)
    signals.set(Client("s1", "a", "controller"), "x", (0.0,), 5.11)
    assert code_of(signals, Client("s1", "a", "controller"), "x", (0.0,), 5.12) == "signal_rate"
    for _ in range(10):
        signals.set(
            Client("s1", "a", "controller"), "x", (0.0,), 100.0
        )  # no more than one second's worth is saved up
    assert code_of(signals, Client("s1", "a", "controller"), "x", (0.0,), 100.0) == "signal_rate"


# --- authority --------------------------------------------------------------------------------------------


def sharer(name="a", role="controller", session=None, known_as=None):
    return Client(session or name, name, role, known_as=known_as)


@pytest.fixture
def ruled():
    reserved = {
        "operator.": Reserved(operator=True),
        "lead.": Reserved(operator=False, clients=frozenset({"leader"})),
        "lead.open.": Reserved(operator=False),
        "local.": Reserved(operator=False, clients=frozenset({"uid 1000"})),
    }
    return Signals(1000.0, per_client=32, reserved=reserved)


def test_names_under_a_prefix_are_for_its_role(ruled):
    assert code_of(ruled, sharer(), "operator.distance", (1.0,), 0.0) == "forbidden"
    assert ruled.values == {}
    ruled.set(sharer("boss", "operator"), "operator.distance", (1.0,), 0.0)
    ruled.set(sharer(), "operators", (1.0,), 0.0)


def test_names_under_a_prefix_are_for_its_clients_by_token_and_else_by_name(ruled):
    assert code_of(ruled, sharer("other"), "lead.progress", (1.0,), 0.0) == "forbidden"
    assert code_of(ruled, sharer("leader", known_as="other"), "lead.progress", (1.0,), 0.0) == "forbidden"
    ruled.set(sharer("x", known_as="leader"), "lead.progress", (1.0,), 0.0)
    ruled.drop("x")
    ruled.set(sharer("leader"), "lead.progress", (1.0,), 0.0)


def test_the_longest_prefix_counts(ruled):
    ruled.set(sharer("other"), "lead.open.x", (1.0,), 0.0)


def test_a_client_has_its_own_bound_and_a_token_one_for_all_its_sessions(ruled):
    for number in range(16):
        ruled.set(sharer("a"), f"a{number}", (0.0,), 0.0)
        ruled.set(sharer("b", session=f"b{number % 2}", known_as="lab"), f"b{number}", (0.0,), 0.0)
    few = Signals(1000.0, per_client=2)
    few.set(sharer("x", session="s1", known_as="lab"), "x", (0.0,), 0.0)
    few.set(sharer("y", session="s2", known_as="lab"), "y", (0.0,), 0.0)
    assert code_of(few, sharer("z", session="s3", known_as="lab"), "z", (0.0,), 0.0) == "too_many_signals"
    few.drop("s1")
    few.set(sharer("z", session="s3", known_as="lab"), "z", (0.0,), 0.0)


def test_clients_cannot_use_up_the_places_of_reserved_names(ruled):
    for number in range(64 - KEPT):
        ruled.set(sharer(f"c{number // 10}"), f"x{number}", (0.0,), 0.0)
    assert code_of(ruled, sharer("more"), "y", (0.0,), 0.0) == "too_many_signals"
    ruled.set(sharer("leader"), "lead.progress", (0.0,), 0.0)
    ruled.set(sharer("boss", "operator"), "operator.distance", (0.0,), 0.0)


def test_users_of_the_unix_socket_are_identified_by_number_and_not_by_their_claimed_name(ruled):
    assert code_of(ruled, sharer("leader", known_as="uid 1000"), "lead.progress", (1.0,), 0.0) == "forbidden"
    assert code_of(ruled, sharer("uid:1000", known_as="uid 1001"), "local.x", (1.0,), 0.0) == "forbidden"
    ruled.set(sharer("x", known_as="uid 1000"), "local.x", (1.0,), 0.0)


def test_a_user_has_one_bound_for_all_sessions():
    few = Signals(1000.0, per_client=1)
    few.set(sharer("x", session="s1", known_as="uid 1000"), "x", (0.0,), 0.0)
    again = sharer("y", session="s2", known_as="uid 1000")
    assert code_of(few, again, "y", (0.0,), 0.0) == "too_many_signals"
    few.set(sharer("y", session="s3", known_as="uid 1001"), "y", (0.0,), 0.0)


def test_a_rule_names_tokens_and_users(tmp_path):
    config = arms_config(tmp_path, server='{signals: {lead.: {clients: ["uid 1000", leader]}}}')
    assert config.server.signals["lead."].clients == ("uid 1000", "leader")
    with pytest.raises(ConfigError, match="clients"):
        arms_config(tmp_path, server='{signals: {lead.: {clients: ["uid root"]}}}')

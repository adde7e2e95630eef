"""Bounds on connections: reserved places, and connections that are closed to make room."""

import pytest

from armgate.daemon.sessions.connection_limits import ConnectionLimits

HERE, THERE = "192.0.2.1", "192.0.2.2"


class LimitsBench:
    """Limits whose connections are numbered in the order in which they came."""

    def __init__(self, in_all=128, per_origin=64):
        self.limits = ConnectionLimits(in_all, per_origin)
        self.slots = []

    def connect(self, count=1, origin=HERE):
        """Add connections; return the numbers of those that were closed to make room."""
        evicted = []
        for _ in range(count):
            slot, out = self.limits.enter(origin)
            self.slots.append(slot)
            evicted += [] if out is None else [self.slots.index(out)]
        return evicted

    def login(self, role, origin=HERE, token=""):
        """Add a client and its hello; return the reason why there is no place for it."""
        self.connect(1, origin)
        slot = self.slots[-1]
        return slot.refusal or self.limits.admit(slot, role, token)

    def fill(self, role, origin=HERE, token=""):
        """Return how many clients of a role are accepted before the first refusal."""
        count = 0
        while not self.login(role, origin, token):
            count += 1
        return count


def test_ninety_silent_connections_keep_no_client_out():
    bench = LimitsBench()
    bench.connect(90)
    assert bench.login("operator") == ""
    assert bench.login("observer") == ""


def test_the_oldest_silent_connection_is_closed_to_make_room_and_no_session():
    bench = LimitsBench(per_origin=4)
    assert bench.login("controller") == ""
    assert bench.connect(3) == []
    assert bench.connect(2) == [1, 2]
    for number in (3, 4, 5):
        assert bench.limits.admit(bench.slots[number], "operator", "") == ""
    bench.connect(1)
    assert "from your address" in bench.slots[-1].refusal


def test_the_address_with_most_silent_connections_makes_room():
    bench = LimitsBench(in_all=6)
    bench.connect(2, THERE)
    bench.connect(4, HERE)
    assert bench.connect(1, THERE) == [2]


def test_idle_sessions_of_one_address_leave_places_for_higher_roles():
    bench = LimitsBench()
    assert bench.fill("observer") == 56
    assert bench.fill("controller") == 4
    assert bench.fill("operator") == 4


def test_sessions_of_many_addresses_leave_places_for_higher_roles():
    bench = LimitsBench(in_all=128)
    origins = [f"192.0.2.{number}" for number in range(8)]
    assert sum(bench.fill("observer", origin) for origin in origins) == 112
    assert sum(bench.fill("controller", origin) for origin in origins) == 8
    assert sum(bench.fill("operator", origin) for origin in origins) == 8


def test_one_token_has_no_more_places_from_many_addresses_than_from_one():
    bench = LimitsBench()
    assert sum(bench.fill("observer", f"192.0.2.{number}", "eye") for number in range(4)) == 56
    assert bench.login("observer", THERE, "other") == ""
    assert "with your token" in bench.login("observer", THERE, "eye")


@pytest.mark.parametrize("role", ["observer", "controller", "operator"])
def test_a_place_is_free_again_when_its_connection_is_closed(role):
    bench = LimitsBench(in_all=2, per_origin=2)
    assert bench.fill(role) == 2
    bench.limits.leave(bench.slots[0])
    assert bench.login(role) == ""
    for slot in bench.slots:
        bench.limits.leave(slot)
    assert bench.limits.empty


def test_a_connection_that_has_sent_nothing_makes_room_before_one_that_has():
    bench = LimitsBench(per_origin=3)
    bench.connect(3)
    bench.slots[0].silent = False
    assert bench.connect(1) == [1]
    for slot in bench.slots:
        slot.silent = False
    assert bench.connect(1) == [0]

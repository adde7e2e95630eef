"""Bounds on connections: reserved places, and connections that are closed to make room."""

import pytest

from armgate.daemon.sessions.connection_limits import ConnectionLimits

HERE, THERE = "192.0.2.1", "192.0.2.2"


class Hall:
    """Limits whose connections are numbered in the order in which they came."""

    def __init__(self, in_all=128, per_origin=64):
        self.room = ConnectionLimits(in_all, per_origin)
        self.guests = []

    def come(self, count=1, origin=HERE):
        """Add connections; return the numbers of those that were closed to make room."""
        evicted = []
        for _ in range(count):
            guest, out = self.room.enter(origin)
            self.guests.append(guest)
            evicted += [] if out is None else [self.guests.index(out)]
        return evicted

    def login(self, role, origin=HERE, token=""):
        """Add a client and its hello; return the reason why there is no place for it."""
        self.come(1, origin)
        guest = self.guests[-1]
        return guest.refusal or self.room.admit(guest, role, token)

    def fill(self, role, origin=HERE, token=""):
        """Return how many clients of a role are accepted until one is not."""
        count = 0
        while not self.login(role, origin, token):
            count += 1
        return count


def test_ninety_silent_connections_keep_no_client_out():
    hall = Hall()
    hall.come(90)
    assert hall.login("operator") == ""
    assert hall.login("observer") == ""


def test_the_oldest_silent_connection_is_closed_to_make_room_and_no_session():
    hall = Hall(per_origin=4)
    assert hall.login("controller") == ""
    assert hall.come(3) == []
    assert hall.come(2) == [1, 2]
    for number in (3, 4, 5):
        assert hall.room.admit(hall.guests[number], "operator", "") == ""
    hall.come(1)
    assert "from your address" in hall.guests[-1].refusal


def test_the_address_with_most_silent_connections_makes_room():
    hall = Hall(in_all=6)
    hall.come(2, THERE)
    hall.come(4, HERE)
    assert hall.come(1, THERE) == [2]


def test_idle_sessions_of_one_address_leave_places_for_higher_roles():
    hall = Hall()
    assert hall.fill("observer") == 56
    assert hall.fill("controller") == 4
    assert hall.fill("operator") == 4


def test_sessions_of_many_addresses_leave_places_for_higher_roles():
    hall = Hall(in_all=128)
    origins = [f"192.0.2.{number}" for number in range(8)]
    assert sum(hall.fill("observer", origin) for origin in origins) == 112
    assert sum(hall.fill("controller", origin) for origin in origins) == 8
    assert sum(hall.fill("operator", origin) for origin in origins) == 8


def test_one_token_has_no_more_places_from_many_addresses_than_from_one():
    hall = Hall()
    assert sum(hall.fill("observer", f"192.0.2.{number}", "eye") for number in range(4)) == 56
    assert hall.login("observer", THERE, "other") == ""
    assert "with your token" in hall.login("observer", THERE, "eye")


@pytest.mark.parametrize("role", ["observer", "controller", "operator"])
def test_a_place_is_free_again_when_its_connection_is_closed(role):
    hall = Hall(in_all=2, per_origin=2)
    assert hall.fill(role) == 2
    hall.room.leave(hall.guests[0])
    assert hall.login(role) == ""
    for guest in hall.guests:
        hall.room.leave(guest)
    assert hall.room.empty


def test_a_connection_that_has_sent_nothing_makes_room_before_one_that_has():
    hall = Hall(per_origin=3)
    hall.come(3)
    hall.guests[0].silent = False
    assert hall.come(1) == [1]
    for guest in hall.guests:
        guest.silent = False
    assert hall.come(1) == [0]

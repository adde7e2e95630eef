"""Repeated stops are one stop, and the number of stops is bounded for any sequence of stops."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.gate.stops import FAULT, LINK, MAX_CLIENT_STOPS, MET, REMEMBERED, StopCause, Stops

CELL = (0, 1, 2)
STOPPED = st.sampled_from([(0,), (1,), (2,), CELL])
CAUSES = st.one_of(
    st.sampled_from([LINK, FAULT, MET]),
    st.builds(StopCause, st.sampled_from("abcdef"), st.integers(0, 9).map(str)),
)


def by_client(why="w", by="a"):
    return StopCause(by, why)


def test_a_repeated_stop_replaces_the_one_before_and_every_id_names_it():
    stops = Stops()
    assert [stops.raise_((0,), by_client()) for _ in range(3)] == [(1, None), (2, 1), (3, 2)]
    assert stops.of(0) == [3]
    assert {stops.find(id_).id for id_ in (1, 2, 3)} == {3}
    stops.lift(stops.find(1))
    assert [stops.find(id_) for id_ in (1, 2, 3)] == [None] * 3
    assert stops.of(0) == []


@pytest.mark.parametrize(
    ("robots", "cause"),
    [(CELL, by_client()), ((0,), by_client(why="v")), ((0,), by_client(by="b")), ((0,), LINK)],
)
def test_a_stop_of_other_robots_or_another_cause_is_another_stop(robots, cause):
    stops = Stops()
    stops.raise_((0,), by_client())
    assert stops.raise_(robots, cause) == (2, None)
    assert stops.of(0) == [1, 2]
    stops.lift(stops.find(1))
    assert stops.of(0) == [2]


def test_restarts_of_a_robot_server_leave_one_stop():
    stops = Stops()
    for _ in range(44):
        stops.raise_((0,), LINK)
    assert stops.of(0) == [44]


def test_beyond_the_bound_a_client_replaces_its_own_newest_stop_or_else_the_newest():
    stops = Stops()
    for number in range(MAX_CLIENT_STOPS - 2):
        stops.raise_((0,), by_client(why=f"{number}"))
    mine, last = stops.raise_((0,), by_client(by="b"))[0], stops.raise_((0,), by_client(by="c"))[0]
    again = stops.raise_((0,), by_client(by="b", why="more"))
    assert again == (MAX_CLIENT_STOPS + 1, mine)
    assert stops.raise_((0,), by_client(by="d")) == (MAX_CLIENT_STOPS + 2, again[0])
    assert last in stops.of(0)
    assert stops.raise_((0,), FAULT)[1] is None  # the gate's own stops do not count for the clients' bound


def test_the_number_of_remembered_replaced_ids_is_bounded():
    stops = Stops()
    for _ in range(REMEMBERED + 10):
        newest, _ = stops.raise_((0,), by_client())
    assert stops.find(1) is None
    assert stops.find(newest - REMEMBERED).id == newest
    assert len(stops._replaced) == REMEMBERED
    stops.lift(stops.find(newest))
    assert not stops._replaced


@given(st.lists(st.one_of(st.tuples(STOPPED, CAUSES), st.integers(1, 300)), max_size=300))
def test_the_bound_holds_and_each_robot_stays_stopped_until_the_last_reset(actions):
    stops, model = (
        Stops(),
        {},
    )  # the model: the robots of each reported id, until a reset that names an id of the same stop
    for action in actions:
        if isinstance(action, int):
            found = stops.find(action)
            assert (found is not None) == (action in model)
            if found is not None:
                kin = model[action]
                stops.lift(found)
                model = {id_: other for id_, other in model.items() if other is not kin}
        else:
            robots, cause = action
            id_, replaced = stops.raise_(robots, cause)
            assert all(id_ > other for other in model)
            model[id_] = [robots] if replaced is None else model[replaced]
            assert model[id_][0] == robots
        for robot in CELL:
            mine = stops.of(robot)
            assert len(mine) <= 2 * MAX_CLIENT_STOPS + 3
            assert mine == sorted(mine)
            assert bool(mine) == any(robot in kin[0] for kin in model.values())

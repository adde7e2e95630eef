"""Backlog of states that arrive faster than the program reads them."""

from armgate.client.session import Session
from armgate.protocol.messages import State


def states(session: Session, *ticks: int) -> None:
    for tick in ticks:
        session._take_state(State(robot="FR", tick=tick, time=0.0, entries=()))


def taken(session: Session, seen: int) -> list[int]:
    found = []
    while (item := session.next_state(seen)) is not None:
        seen, state = item
        found.append(state.tick)
    return found


def test_without_a_backlog_only_the_newest_state_is_returned() -> None:
    session = Session()
    states(session, 1, 2, 3)
    assert taken(session, 0) == [3]
    assert taken(session, 3) == []


def test_a_backlog_returns_all_states_in_order_and_drops_the_oldest() -> None:
    session = Session()
    states(session, 1)
    session.keep_states(3)
    states(session, 2, 3)
    assert taken(session, 0) == [1, 2, 3]
    assert taken(session, 2) == [3]
    states(session, 4, 5)
    assert taken(session, 0) == [3, 4, 5]
    assert taken(session, 5) == []

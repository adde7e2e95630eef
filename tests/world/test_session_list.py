"""Operators list the sessions and end one of them."""

import pytest

from armgate.protocol import messages as m
from support.cells import arms_config
from support.peers import Bench


@pytest.fixture
def bench(tmp_path):
    return Bench(arms_config(tmp_path)).start()


def code(peer):
    return peer.last(m.Error).code


def test_an_operator_lists_all_sessions_in_order(bench):
    holder, _ = bench.holder("wave", "B")
    boss, eye = bench.client("boss", "operator"), bench.client("eye", "observer")
    boss.change(token="alice")
    bench.core.handle(boss, m.Sessions(id=3))
    listed = boss.last(m.SessionList)
    assert listed.re == 3
    assert [(s.session, s.name, s.role, s.token, s.robots) for s in listed.sessions] == [
        (holder.client.id, "wave", "controller", None, ("B",)),
        (boss.client.id, "boss", "operator", "alice", ()),
        (eye.client.id, "eye", "observer", None, ()),
    ]


def test_an_operator_ends_a_session(bench):
    holder, _ = bench.holder("wave", "B")
    boss = bench.client("boss", "operator")
    bench.core.handle(boss, m.Kick(session=holder.client.id, reason="too fast", id=4))
    assert boss.last(m.Kicked) == m.Kicked(re=4, session=holder.client.id)
    error = holder.last(m.Error)
    assert (error.code, error.fatal, error.text) == ("kicked", True, "boss ended this session: too fast")
    assert holder.ended


def test_an_unknown_session_cannot_be_ended(bench):
    boss = bench.client("boss", "operator")
    bench.core.handle(boss, m.Kick(session="s99", id=4))
    assert code(boss) == "unknown_session"


@pytest.mark.parametrize("role", ["observer", "controller"])
@pytest.mark.parametrize("request_", [m.Sessions(), m.Kick(session="s1")], ids=["sessions", "kick"])
def test_only_operators_may_list_or_end_sessions(bench, role, request_):
    bench.client("first")
    peer = bench.client("x", role)
    bench.core.handle(peer, request_)
    assert code(peer) == "forbidden"


def test_the_robots_of_a_session_are_looked_up_once(bench, monkeypatch):
    boss, asked = bench.client("boss", "operator"), []
    held_by = bench.core.leasing.held_by
    monkeypatch.setattr(
        bench.core.leasing, "held_by", lambda session: asked.append(session) or held_by(session)
    )
    bench.core.handle(boss, m.Sessions())
    assert asked.count(boss.client.id) == 1

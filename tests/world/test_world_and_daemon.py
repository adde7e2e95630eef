"""A world and a lock-step daemon send the same bytes to the same clients, for random sessions."""

import random
from collections import Counter

import pytest

from armgate.cell.cell import build_cell
from armgate.world import World
from support.cells import arms_config
from support.daemons import serving
from support.sessions import RandomSessions, repeat

SEEDS = range(32)


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    clock = "{kind: lockstep, participants: [a, b], grace: 1000}"
    server = "{port: 0, lease_ttl: 1.0, signals_per_client: 3}"
    folder = tmp_path_factory.mktemp("arms")
    return build_cell(arms_config(folder, periods=(0.012, 0.004), lag=0.03, clock=clock, server=server))


def sessions(cell, seed, count=600):
    return RandomSessions(World(cell), random.Random(seed)).run(count)


@pytest.mark.daily(4)
@pytest.mark.parametrize("seed", SEEDS)
async def test_a_daemon_sends_the_same_bytes_as_a_world(cell, seed):
    found = sessions(cell, seed)
    async with serving(cell) as port:
        repeated = await repeat(port, found.actions)
    assert len(repeated) == len(found.received)
    for number, (raw, frames) in enumerate(zip(repeated, found.received, strict=True)):
        assert raw == b"".join(frames), f"connection {number}"


def test_random_sessions_reach_what_they_are_for(cell):
    kinds = Counter()
    for seed in range(24):
        found = sessions(cell, seed)
        kinds.update(type(action).__name__ for action in found.actions)
        kinds.update(found.kinds)
    assert kinds["Join"] > 12
    assert kinds["Leave"] > 3
    assert kinds.keys() >= {
        "admitted", "refused", "held", "lost", "released", "stopped", "resumed", "state", "signaled",
        "subscribed", "description", "kicked", "name_taken", "not_participant", "wrong_step", "unknown_robot",
        "leased", "forbidden", "fence",
    }  # fmt: skip

"""The programs of docs/env.md run and do what the page states."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "env.md").read_text(encoding="utf-8")
FIRST, REWARD, CELL, STATES, VECTOR = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture
def names(tmp_path, monkeypatch, capsys):
    """Return the names of the first program, and its output as ``printed``."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    monkeypatch.chdir(tmp_path)
    known = {}
    exec(FIRST, known)
    return known | {"printed": capsys.readouterr().out}


def test_the_first_program_prints_the_last_verdict_and_the_distance(names):
    measures = r"\{'distance': [\d.e-]+, 'success': [01]\.0\}"
    assert re.fullmatch(rf"(admitted|limited|refused) {measures}\n", names["printed"])


def test_the_page_lists_every_key_of_the_info(names):
    table = PAGE.split("| key of `info` | |")[1].split("\n\n")[0]
    keys = {key for row in table.splitlines()[2:] for key in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert keys == set(names["info"])


def test_the_reward_function_replaces_the_reward(names):
    exec(REWARD, names)
    env = names["env"]
    env.reset(seed=0)
    rewards = [env.step([1.0, -1.0, -1.0])[1] for _ in range(60)]
    assert min(rewards) < -0.1


def test_any_cell_can_be_used(names):
    exec(CELL, names)
    env = names["env"]
    env.reset(seed=0)
    assert env.action_space.shape == (6,)
    _, reward, _, _, info = env.step([0.0] * 6)
    assert reward == info["margin"]


def test_saved_episodes_continue(names):
    exec(STATES, names)
    env = names["env"]
    time = env.reset(options={"state": names["state"]})[1]["time"]
    assert time > env.reset(options={"place": 3})[1]["time"]


def test_workers_step_several_environments(names):
    exec(VECTOR, names)
    assert names["rewards"].shape == (8,)
    assert names["infos"]["outcome"].shape == (8,)

"""The training example: its environment, its counts and its curves; the training itself needs torch."""

import importlib
import sys
import types
from pathlib import Path

import numpy as np
import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "rl"


@pytest.fixture
def example(monkeypatch):
    """Return the modules of the example."""
    monkeypatch.syspath_prepend(str(EXAMPLE))
    yield importlib.import_module("train"), importlib.import_module("curves")
    for name in ("train", "curves"):
        sys.modules.pop(name)


def test_the_penalty_counts_limited_and_refused_commands(example):
    train, _ = example
    rewards = {}
    for name in train.REWARDS:
        env = train.make_env(name)
        env.reset(seed=0, options={"place": 0, "goal": [0.5, 0.5, 0.5]})
        steps = [env.step([1.0, -1.0, -1.0]) for _ in range(45)]
        rewards[name] = np.array([step[1] for step in steps])
        refused = np.array([step[4]["outcome"] != "admitted" for step in steps])
    difference = rewards["task"] - rewards["task and verdict"]
    assert refused.any()
    assert not difference[~refused].any()
    assert (difference[refused] >= train.PENALTY - 1e-12).all()


def test_episodes_are_counted(example):
    train, _ = example
    counter = train.EpisodeCounter("task", 3)
    infos = [("admitted", 0.0), ("limited", 0.0), ("refused", 1.0), ("refused", 0.0)]
    rows = [
        counter.add({"outcome": outcome, "measures": {"success": reached}}, done)
        for (outcome, reached), done in zip(infos, (False, False, True, True), strict=True)
    ]
    assert rows == [
        None,
        None,
        train.EpisodeRow("task", 3, step=3, length=3, success=1, limited=1, refused=1),
        train.EpisodeRow("task", 3, step=4, length=1, success=0, limited=0, refused=1),
    ]


def test_curves_average_the_episodes_of_each_seed_in_each_window(example):
    train, curves = example
    rows = [
        train.EpisodeRow("task", seed, step, 50, int(step > 60), 5, seed)
        for seed in (0, 1)
        for step in (50, 100)
    ]
    ends, values = curves.curve(rows, curves.success, window=60)
    assert ends.tolist() == [60, 120]
    assert values.tolist() == [[0.0, 1.0], [0.0, 1.0]]
    assert curves.curve(rows, curves.restricted, window=200)[1].tolist() == [[0.1], [0.12]]


class RandomAgent:
    """Stand-in for an agent of stable-baselines3: random actions, and its callback after each step."""

    def __init__(self, _policy, env, *, seed, **_options):
        self.env = env
        env.action_space.seed(seed)

    def learn(self, steps, callback):
        self.env.reset(seed=0)
        for _ in range(steps):
            _, _, terminated, truncated, info = self.env.step(self.env.action_space.sample())
            done = terminated or truncated
            callback.locals = {"infos": [info], "dones": [done]}
            assert callback._on_step()
            if done:
                self.env.reset()


def test_the_script_writes_the_episodes_of_all_agents(example, tmp_path, monkeypatch, capsys):
    train, curves = example
    library = types.ModuleType("stable_baselines3")
    library.SAC = RandomAgent
    callbacks = types.ModuleType("stable_baselines3.common.callbacks")
    callbacks.BaseCallback = object
    torch = types.ModuleType("torch")
    torch.set_num_threads = lambda count: None
    for module in (library, types.ModuleType("stable_baselines3.common"), callbacks, torch):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(sys, "argv", ["train.py", "--steps", "110", "--seeds", "1", "--out", str(tmp_path)])
    train.main()
    rows = curves.read(tmp_path / "episodes.csv")
    assert {row.reward for row in rows} == set(train.REWARDS)
    assert all(1 <= row.length <= 100 for row in rows)
    assert capsys.readouterr().out.count("goals reached") == 2


def test_the_picture_of_the_documentation_is_drawn_from_the_episodes(example, tmp_path):
    _, curves = example
    rows = curves.read(EXAMPLE / "episodes.csv")
    assert {(row.reward, row.seed) for row in rows} == {
        (reward, seed) for reward in ("task", "task and verdict") for seed in range(3)
    }
    curves.draw(rows, tmp_path / "curves.svg")
    assert (tmp_path / "curves.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_the_table_of_the_documentation_is_computed_from_the_episodes(example):
    _, curves = example
    page = (EXAMPLE.parents[1] / "docs" / "env.md").read_text(encoding="utf-8")
    late = [row for row in curves.read(EXAMPLE / "episodes.csv") if row.step > 8000]
    for title, measure in (
        ("goals reached", curves.success),
        ("steps with a limited or refused command", curves.restricted),
    ):
        cells = [
            ", ".join(
                f"{100 * measure([row for row in late if (row.reward, row.seed) == (reward, seed)]):.0f} %"
                for seed in range(3)
            )
            for reward in ("task", "task and verdict")
        ]
        assert f"| {title} | {' | '.join(cells)} |" in page

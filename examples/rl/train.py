"""Train a small agent to reach points between posts, with and without the gate's verdict in the reward.

    python train.py --out results            # 2 rewards x 3 seeds, about a quarter of an hour on one core
    python curves.py results/episodes.csv    # draws the curves

The agent is SAC of stable-baselines3 with two small layers. One row of ``episodes.csv`` is one episode.
"""

import argparse
import csv
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import gymnasium

from armgate.env import Transition

PENALTY = 0.1
"""Penalty for each command that the gate limits or refuses."""

REWARDS: dict[str, Callable[[Transition], float] | None] = {
    "task": None,
    "task and verdict": lambda step: step.reward - PENALTY * (step.refused + step.limited),
}
"""Reward functions by name; None is the reward of the task."""


@dataclass(frozen=True)
class EpisodeRow:
    """One episode of a training run.

    Attributes:
        reward: Name of the reward function.
        seed: Seed of the run.
        step: Step of the training at which the episode ended.
        length: Number of its steps.
        success: 1 if the goal was reached, else 0.
        limited: Number of its steps in which the gate limited a command, and refused none.
        refused: Number of its steps in which the gate refused a command.
    """

    reward: str
    seed: int
    step: int
    length: int
    success: int
    limited: int
    refused: int


class EpisodeCounter:
    """Counter of one environment: `add` each step, and write a row when an episode ends."""

    def __init__(self, reward: str, seed: int) -> None:
        self._name, self._seed = reward, seed
        self._steps = 0
        self._clear()

    def _clear(self) -> None:
        self._length = self._limited = self._refused = 0

    def add(self, info: dict[str, Any], done: bool) -> EpisodeRow | None:
        """Count a step; return the row of the episode if it has ended."""
        self._steps += 1
        self._length += 1
        self._limited += info["outcome"] == "limited"
        self._refused += info["outcome"] == "refused"
        if not done:
            return None
        success = int(info["measures"]["success"])
        row = EpisodeRow(
            self._name, self._seed, self._steps, self._length, success, self._limited, self._refused
        )
        self._clear()
        return row


def make_env(reward: str) -> gymnasium.Env:
    """Return the environment: a planar arm between posts, one action for 48 ms, at most 4.8 s."""
    return gymnasium.make(
        "armgate.env:armgate/Reach-v0",
        reward=REWARDS[reward],
        repeat=4,
        places=64,
        spread=0.15,
        max_episode_steps=100,
    )


def train(reward: str, seed: int, steps: int) -> Iterator[EpisodeRow]:
    """Train one agent; yield a row for each episode."""
    import torch
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback

    class Count(BaseCallback):
        def _on_step(self) -> bool:
            row = counter.add(self.locals["infos"][0], bool(self.locals["dones"][0]))
            if row is not None:
                rows.append(row)
            return True

    torch.set_num_threads(1)
    counter, rows = EpisodeCounter(reward, seed), list[EpisodeRow]()
    agent = SAC(
        "MlpPolicy",
        make_env(reward),
        seed=seed,
        learning_starts=500,
        train_freq=2,
        batch_size=128,
        learning_rate=1e-3,
        gamma=0.97,
        policy_kwargs={"net_arch": [64, 64]},
        device="cpu",
    )
    agent.learn(steps, callback=Count())
    yield from rows


def main() -> None:
    """Train all agents, one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--steps", type=int, default=12_000, help="steps of each agent")
    parser.add_argument("--seeds", type=int, default=3, help="agents for each reward")
    parser.add_argument("--out", type=Path, default=Path("results"), help="folder of episodes.csv")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "episodes.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(field.name for field in fields(EpisodeRow))
        for seed in range(options.seeds):
            for reward in REWARDS:
                rows = list(train(reward, seed, options.steps))
                table.writerows(astuple(row) for row in rows)
                file.flush()
                reached = [row.success for row in rows[-50:]]
                print(f"{reward}, seed {seed}: {sum(reached)} of the last {len(reached)} goals reached")


if __name__ == "__main__":
    main()

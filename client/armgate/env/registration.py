"""The environments that are registered with Gymnasium."""

from pathlib import Path
from types import ModuleType
from typing import Any

from armgate.apps.default_files import default_file
from armgate.env.cell_env import CellEnv, CellFiles
from armgate.env.follow import Follow
from armgate.env.path_leader import PathLeader
from armgate.env.reach import Reach

STEPS = {"armgate/Cell-v0": 1000, "armgate/Reach-v0": 300, "armgate/Follow-v0": 1000}
"""Steps after which an episode is truncated; ``max_episode_steps`` of ``gymnasium.make`` changes it."""


def register_all(gymnasium: ModuleType) -> None:
    """Register the environments, once."""
    makers = {"armgate/Cell-v0": CellEnv, "armgate/Reach-v0": reach_env, "armgate/Follow-v0": follow_env}
    for name, maker in makers.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=maker, max_episode_steps=STEPS[name])


def reach_env(
    cell: CellFiles | None = None,
    robots: str | None = None,
    *,
    tolerance: float = 0.05,
    random_start: bool = True,
    **options: Any,
) -> CellEnv:
    """Return an environment with the task `Reach`, by default for the planar arm between posts.

    Args:
        cell: The cell; None: ``planar.yaml``.
        robots: The agent's robot; None: the only one without a program.
        tolerance: Distance at which the goal is reached, m.
        random_start: True to begin each episode at a random place.
        options: Arguments of `CellEnv`.
    """
    files = default_file("planar.yaml") if cell is None else cell
    return CellEnv(files, robots, task=Reach(tolerance=tolerance), random_start=random_start, **options)


def follow_env(
    cell: CellFiles | None = None,
    robots: str | None = "FR",
    *,
    leader: str = "GR",
    path: str | Path | None = None,
    distance: float = 1.0,
    **options: Any,
) -> CellEnv:
    """Return an environment with the task `Follow`: the agent's camera follows a leader on a path.

    Args:
        cell: The cell; None: the demo cell.
        robots: The agent's robot, which has a camera.
        leader: Robot that plays the path.
        path: File of the path; None: that of the demo.
        distance: Wanted distance of the camera from the leader's tool, m.
        options: Arguments of `CellEnv`.
    """
    files = default_file("demo.yaml") if cell is None else cell
    file = default_file("paths/inspection.csv") if path is None else Path(path)
    return CellEnv(
        files,
        robots,
        programs={leader: PathLeader(file)},
        task=Follow(robots, leader, distance),
        **options,
    )

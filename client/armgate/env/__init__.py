"""Gymnasium environments over a world: an agent commands robots through the gate.

Importing this package registers ``armgate/Cell-v0``, ``armgate/Reach-v0`` and ``armgate/Follow-v0``, so that
``gymnasium.make("armgate.env:armgate/Reach-v0")`` works. docs/env.md is the tutorial.

- ``cell_env``: the environment; ``registration``: the three that are registered.
- ``tasks``, ``reach``, ``follow``: goals, with their observations and rewards; ``transition``: their input.
- ``actions``, ``observations``, ``info``: conversions between numbers of an agent and messages.
- ``episode``, ``seat``: the world of an episode, and the agent as its client; ``places``: starts.
- ``recordings``: recordings of episodes; ``vector``: several environments per worker process.
"""

try:
    import gymnasium as _gymnasium
except ModuleNotFoundError as error:
    from armgate.cell.errors import install_hint

    raise ModuleNotFoundError(f"gymnasium is not installed; run {install_hint('env')}") from error

from armgate.env.cell_env import CellEnv
from armgate.env.errors import ActionError, EnvError
from armgate.env.follow import Follow
from armgate.env.reach import Reach
from armgate.env.registration import register_all
from armgate.env.tasks import Assessment, Free, Scene, Task
from armgate.env.transition import ArmState, Transition
from armgate.env.vector import WorkerVectorEnv

__all__ = [
    "ActionError",
    "ArmState",
    "Assessment",
    "CellEnv",
    "EnvError",
    "Follow",
    "Free",
    "Reach",
    "Scene",
    "Task",
    "Transition",
    "WorkerVectorEnv",
]

register_all(_gymnasium)

"""Who does what in the demo."""

from collections.abc import Sequence
from pathlib import Path

from armgate.apps.stack.robots import Robots
from armgate.apps.stack.run import FOLLOWER, LEADER, Plan

NAMES = (LEADER, FOLLOWER)
"""The demo's participants."""


def plan(
    configs: Sequence[Path],
    path: Path,
    leader: str,
    follower: str,
    *,
    lag: float = 0.03,
    lockstep: bool = False,
    duration: float | None = None,
    robots: Robots | None = None,
) -> Plan:
    """One robot plays a path, the other one keeps its camera on it.

    Args:
        configs: Configuration files of the daemon, later ones overlay earlier ones.
        path: The leader's recorded path.
        leader: The robot that is led along the path.
        follower: The robot that carries the camera.
        lag: Of the follower's robot behind its setpoint, s.
        lockstep: Whether ticks wait for the controllers instead of the clock.
        duration: How much of the path is played, s; None for all.
        robots: What holds the robots, and stands in for them; None: the daemon does.
    """
    lead = ["lead", "--robot", leader, "--path", str(path)]
    lead += [] if duration is None else ["--duration", str(duration)]
    follow = ["follow", "--robot", follower, "--leader", leader, "--lag", str(lag)]
    return Plan(configs, follower, {LEADER: lead, FOLLOWER: follow}, lockstep, robots=robots)

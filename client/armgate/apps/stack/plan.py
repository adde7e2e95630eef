"""Plan of a run: which processes are started, with which options and priorities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.apps.stack.robot_processes import RobotProcesses

DAEMON, LEADER, FOLLOWER, VIEWER = "daemon", "leader", "follower", "viewer"
PRIORITIES = {"monitor": 9, "controller": 10, "daemon": 11, "robots": 12}
"""Of real-time processes by the wall clock: the nearer to the robots, the higher.

Participants that load their libraries would take a KRC of the same priority its turn for 0.1 s.
"""
ORDINARY = 0


@dataclass(frozen=True)
class Plan:
    """What is run.

    Attributes:
        configs: Configuration files of the daemon, later ones overlay earlier ones.
        follower: The robot that carries the camera, whose ticks are watched.
        controllers: Participants by name, each an ``armgate`` command without the daemon's address and the
            name.
        lockstep: Whether ticks wait for the controllers instead of the clock.
        until: Whose end ends the run; all of them if none is named.
        record: The folder that the daemon records into; None for none.
        robots: What holds the robots, and stands in for them; None: the daemon does.
        view: Whether a viewer shows the run.
        monitor: True if the run is watched by a second judge: by the clock live, in lock-step afterwards, by
            the recording.
    """

    configs: Sequence[Path]
    follower: str
    controllers: Mapping[str, Sequence[str]]
    lockstep: bool = False
    until: tuple[str, ...] = ()
    record: Path | None = None
    robots: RobotProcesses | None = None
    view: bool = False
    monitor: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """The participants, in order."""
        return tuple(self.controllers)

    def priority(self, what: str) -> int:
        """Return the priority of a kind of process; in lock-step nothing hurries."""
        return ORDINARY if self.lockstep else PRIORITIES[what]

    def daemon(self) -> list[str]:
        """What starts the daemon, after ``armgate``."""
        recording = [] if self.record is None else ["--record", str(self.record)]
        robots = [] if self.robots is None else ["--robot-server", str(self.robots.socket)]
        command = ["serve", *map(str, self.configs), "--port", "0", *recording, *robots]
        return [*command, "--lockstep", ",".join(self.names)] if self.lockstep else command

    def controller(self, name: str, address: str) -> list[str]:
        """What starts a participant, after ``armgate``."""
        command, *options = self.controllers[name]
        return [command, address, *options, "--name", name]

"""Plan of a run: which processes are started, with which options and priorities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from armgate.apps.stack.robot_processes import RobotProcesses

DAEMON, LEADER, FOLLOWER, VIEWER = "daemon", "leader", "follower", "viewer"
PRIORITIES = {"monitor": 9, "controller": 10, "daemon": 11, "robots": 12}
"""Real-time priorities by the wall clock; a process closer to the robots has a higher one.

Participants that load their libraries would block a KRC of the same priority for 0.1 s.
"""
ORDINARY = 0


@dataclass(frozen=True)
class Plan:
    """Processes of one run.

    Attributes:
        configs: Configuration files of the daemon; later ones overlay earlier ones.
        follower: Robot that carries the camera; its ticks are observed.
        controllers: Participants by name, each an ``armgate`` command without the daemon's address and the
            client's name.
        lockstep: True if ticks wait for the controllers instead of the clock.
        until: Participants whose end ends the run; all of them if empty.
        record: Folder of the recording; None for no recording.
        robots: Robot server and virtual KRCs; None if the daemon emulates the robots.
        view: True if a viewer shows the run.
        monitor: True if the monitor checks the run: live by the wall clock, or in lock-step afterwards, from
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
        """Names of the participants, in order."""
        return tuple(self.controllers)

    def priority(self, what: str) -> int:
        """Return the priority of a kind of process; in lock-step all processes are ordinary."""
        return ORDINARY if self.lockstep else PRIORITIES[what]

    def daemon(self) -> list[str]:
        """Return the arguments of ``armgate`` that start the daemon."""
        recording = [] if self.record is None else ["--record", str(self.record)]
        robots = [] if self.robots is None else ["--robot-server", str(self.robots.socket)]
        command = ["serve", *map(str, self.configs), "--port", "0", *recording, *robots]
        return [*command, "--lockstep", ",".join(self.names)] if self.lockstep else command

    def controller(self, name: str, address: str) -> list[str]:
        """Return the arguments of ``armgate`` that start a participant."""
        command, *options = self.controllers[name]
        return [command, address, *options, "--name", name]

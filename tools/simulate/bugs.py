"""Seeded bugs: each is a change of one line of the sources, made while its module is imported.

A simulation has to find each of them. They are mistakes that such a system makes: a stale lease, a lost
verdict, a queue without a bound, a gap in a recording.
"""

import importlib.abc
import importlib.machinery
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Bug:
    """Bug in one module.

    Attributes:
        name: Name of the bug.
        file: File of the module, relative to the repository.
        before: Text that occurs once in the file.
        after: Text in its place.
    """

    name: str
    file: str
    before: str
    after: str

    @property
    def module(self) -> str:
        """Name of the module."""
        return ".".join(Path(self.file).with_suffix("").parts[1:])

    def source(self) -> str:
        """Return the source with the bug.

        Raises:
            ValueError: The text does not occur exactly once.
        """
        text = (_ROOT / self.file).read_text(encoding="utf-8")
        if text.count(self.before) != 1:
            raise ValueError(f"{self.name}: {self.file} contains the text {text.count(self.before)} times")
        return text.replace(self.before, self.after)


_DAEMON, _WORLD = "server/armgate/daemon", "server/armgate/world"
_LINKS = "server/armgate/links"

BUGS = (
    Bug(
        "stale lease kept",
        "protocol/armgate/protocol/lease.py",
        "over = [grant.robot for grant in self._grants.values() if now >= grant.expires]",
        "over: list[str] = []",
    ),
    Bug(
        "session not closed on cut",
        f"{_DAEMON}/sessions/session.py",
        """        self._ending.leave("connection lost" if exc is None else str(exc))
        self._ending.finish()
""",
        "        self._ending.finish()\n",
    ),
    Bug(
        "fence not raised",
        "protocol/armgate/protocol/lease.py",
        "        self._fences[robot] += 1\n",
        "        self._fences[robot] += event is not LeaseEvent.TAKEOVER or not displaced\n",
    ),
    Bug(
        "any session commands with the current fence",
        f"{_WORLD}/core.py",
        "holder = self.leasing.is_holder(peer.client.id, command.robot)",
        "holder = True",
    ),
    Bug(
        "verdict lost when the client reads slowly",
        f"{_DAEMON}/sessions/writing.py",
        """            self._queue.append(frame)
            self._queued += len(frame)
""",
        """            if not delayable or self._queued == 0:
                self._queue.append(frame)
                self._queued += len(frame)
""",
    ),
    Bug(
        "verdict sent twice when the transport resumes",
        f"{_DAEMON}/sessions/writing.py",
        "            self._queued -= len(frame)\n",
        "            self._queued -= len(frame)\n            frame *= 1 if self._queue else 2\n",
    ),
    Bug(
        "state backlog unbounded",
        f"{_DAEMON}/sessions/writing.py",
        """            self._states.pop(robot, None)
            self._states[robot] = frame
""",
        """            self._states[f"{robot} {len(self._states)}"] = frame
""",
    ),
    Bug(
        "states at another rate than subscribed",
        f"{_WORLD}/states.py",
        "return robot in self.robots and tick % self.every == 0",
        "return robot in self.robots and (tick % self.every == 0 or tick % 7 == 3)",
    ),
    Bug(
        "record lost without a gap",
        f"{_DAEMON}/recording/recorder.py",
        "            elif (queued := self._queue.popleft()) is None:\n",
        "            elif len(self._queue) == 7 and self._queue.popleft() and False or "
        "(queued := self._queue.popleft()) is None:\n",
    ),
    Bug(
        "recorder does not flush",
        f"{_DAEMON}/recording/recorder.py",
        "                self._parts.flush()\n",
        "                pass\n",
    ),
    Bug(
        "queue of the recorder unbounded",
        f"{_DAEMON}/recording/recorder.py",
        "        if len(self._queue) >= self._limit:\n            self._lose(item)",
        "        if len(self._queue) >= 64 * self._limit:\n            self._lose(item)",
    ),
    Bug(
        "stop forgotten when the robot server has a new daemon",
        f"{_LINKS}/robot_server/hosted_link.py",
        "self._armed, self._had_daemon = not self._had_daemon, True",
        "self._armed, self._had_daemon = True, True",
    ),
    Bug(
        "second daemon gets the robots",
        f"{_LINKS}/robot_server/server.py",
        "        if self._daemon is not None:\n            return f",
        "        if self._daemon is None:\n            return '' and f",
    ),
    Bug(
        "stop forgotten when another one is reset",
        f"{_WORLD}/stopping.py",
        "return [robot for robot in self._robots if not self._gate.stops(robot)]",
        "return list(self._robots)",
    ),
    Bug(
        "robot moves on after its plan",
        f"{_LINKS}/plan_player.py",
        "if self._held is None or index >= len(self._held.increments):",
        "if self._held is not None and index == len(self._held.increments) > 3:\n"
        "            self._last = Played(self._held.increments[0], self._held.key, index)\n"
        "        elif self._held is None or index >= len(self._held.increments):",
    ),
    Bug(
        "plan played one tick late",
        f"{_LINKS}/plan_player.py",
        "        if key.target <= self._tick:\n",
        "        if key.target < self._tick:\n",
    ),
    Bug(
        "old command accepted",
        "server/armgate/gate/command_checks.py",
        "    if age > max_age:\n",
        "    if age > 3 * max_age:\n",
    ),
    Bug(
        "signals of clients that are gone kept",
        f"{_WORLD}/core.py",
        "            self._signals.drop(peer.client.id)\n",
        "",
    ),
    Bug(
        "silent client never noticed",
        f"{_DAEMON}/sessions/peer_socket.py",
        "        return before and silent\n",
        "        return False\n",
    ),
    Bug(
        "damaged record accepted",
        "protocol/armgate/recording/chunk.py",
        "    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):\n",
        "    if False:\n",
    ),
)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Importer of one module with its bug."""

    def __init__(self, bug: Bug) -> None:
        self._bug = bug

    def find_spec(self, fullname: str, path: object, target: object = None) -> Any:
        """Return the specification of the module with the bug, None for all others."""
        if fullname != self._bug.module:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=str(_ROOT / self._bug.file))

    def exec_module(self, module: types.ModuleType) -> None:
        """Execute the source with the bug."""
        exec(compile(self._bug.source(), self._bug.file, "exec"), module.__dict__)  # noqa: S102


def install(name: str) -> None:
    """Put a bug into the sources, before they are imported.

    Raises:
        ValueError: There is no bug of this name.
    """
    found = [bug for bug in BUGS if bug.name == name]
    if not found:
        raise ValueError(f"no bug {name!r}; expected one of: {', '.join(bug.name for bug in BUGS)}")
    sys.meta_path.insert(0, _Finder(found[0]))

"""Checks of recordings: they hold every event but the permitted tail, and replay bit for bit."""

import random
import tempfile
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path

from armgate.audit.recover import recover_recording
from armgate.audit.replay import replay_recording
from armgate.cell.cell import Cell
from armgate.daemon.recording.recorder import FLUSH
from armgate.events import GateEvent
from armgate.recording import Gap, Recording, RecordingError, Step
from tools.simulate.findings import Findings
from tools.simulate.machine.disk import Disk
from tools.simulate.stack import Life

_TAIL_NS = round(1e9 * (FLUSH + 0.08))
"""Longest time of a run that may be lost if the daemon is killed, ns: two flushes and the worker's poll."""

_DAMAGED = 24
"""Number of copies with one wrong bit that are checked."""


class RecordingChecks:
    """Checks of the recordings of one simulation.

    Args:
        cell: The cell.
        disk: The disk.
        findings: Receives violations.
    """

    def __init__(self, cell: Cell, disk: Disk, findings: Findings) -> None:
        self._cell, self._disk, self._findings = cell, disk, findings

    def check(self, life: Life, *, replay: bool) -> None:
        """Check the recording of one life of a daemon."""
        if life.folder is None or not life.events:
            return
        files = {
            path.name: file.data for path, file in self._disk.files.items() if path.parent == life.folder
        }
        with tempfile.TemporaryDirectory(prefix="armgate-simulation-") as name:
            try:
                self._check(life, _written(Path(name), files), replay)
            except RecordingError as error:
                self._report(life, repr(error).replace(f"{name}/", ""))
        if replay:
            self._check_damaged(life, files)

    def _check_damaged(self, life: Life, files: Mapping[str, bytes | bytearray]) -> None:
        """Check that recordings with one wrong bit are refused, or hold only events of the gate."""
        choose = random.Random(f"{life.folder} {len(life.events)}")  # noqa: S311 (no secret)
        for _ in range(_DAMAGED):
            name, data = choose.choice(list(files.items()))
            damaged = bytearray(data or b"0")
            damaged[choose.randrange(len(damaged))] ^= 1 << choose.randrange(8)
            with tempfile.TemporaryDirectory(prefix="armgate-simulation-") as folder:
                self._check_prefix(life, _written(Path(folder), {**files, name: damaged}))

    def _check_prefix(self, life: Life, folder: Path) -> None:
        """Check that a damaged recording holds no wrong event before its first gap."""
        try:
            recover_recording(folder)
            items = [item for _, item in Recording.open(folder).items()]
        except RecordingError:
            return
        steps = [
            item
            for item in takewhile(lambda item: not isinstance(item, Gap), items)
            if isinstance(item, Step)
        ]
        for step, (_, event) in zip(steps, life.events, strict=False):
            if not _same(step.event, event):
                self._report(life, f"a damaged recording has {step.event} instead of {event}")
                return

    def _check(self, life: Life, folder: Path, replay: bool) -> None:
        clean = life.process.result == 0
        last = life.ended_at - (0 if clean else _TAIL_NS)
        needed = 0 if life.disk_trouble else sum(at < last for at, _ in life.events)
        if not clean:
            try:
                recover_recording(folder)
            except RecordingError:
                if needed:
                    raise
                return
        items = [item for _, item in Recording.open(folder).items()]
        steps = [item for item in items if isinstance(item, Step)]
        gaps = sum(item.steps for item in items if isinstance(item, Gap))
        if not all(_same(step.event, event) for step, (_, event) in zip(steps, life.events, strict=False)):
            if not gaps:
                self._report(life, "the events are not those of the gate")
            return
        if len(steps) + gaps < needed:
            self._report(life, f"{len(steps)} of {len(life.events)} events, {gaps} in gaps; needed {needed}")
        elif replay and not gaps:
            self._replay(life, folder)

    def _replay(self, life: Life, folder: Path) -> None:
        result = replay_recording(Recording.open(folder), self._cell)
        if result.count:
            self._report(life, f"the replay differs: {result.differing[:2]}")

    def _report(self, life: Life, text: str) -> None:
        self._findings.report("recordings are complete", f"{life.folder}: {text}")


def _written(folder: Path, files: Mapping[str, bytes | bytearray]) -> Path:
    """Write files into a folder; return the folder."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder


def _same(one: GateEvent, other: GateEvent) -> bool:
    """Return True if two events are equal; NaN equals itself here."""
    return one == other or repr(one) == repr(other)

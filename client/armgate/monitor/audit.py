"""Audit of a recording: every state that the daemon recorded, judged by the core."""

import binascii
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import ValidationError

from armgate.client import Description
from armgate.monitor.agreement import differences, orders_of
from armgate.monitor.core import Account, Monitor
from armgate.monitor.errors import DescriptionError, MonitorError
from armgate.monitor.model import Cell, build
from armgate.monitor.motion import Sample
from armgate.monitor.samples import sample_of
from armgate.monitor.yaml_files import read_files
from armgate.recording import Header, Recording, RobotState, Step
from armgate.recording.verify import verify

MAX_FILES = 256
MAX_BYTES = 256 << 20
_CONFIG = "config.yaml"


def audit(run: Path, configs: Sequence[Path], silence: float) -> tuple[Cell, Account]:
    """Judge every state of a recording.

    Args:
        run: Its folder, or one of its files.
        configs: The configuration to judge by; the recording's own if there is none.
        silence: A robot without a state for so long is silent, s.

    Raises:
        RecordingError: It is no recording, or it is damaged or incomplete.
        MonitorError: Its configuration cannot be read.
    """
    recording = Recording.open(run)
    try:
        description = recording.description
    except ValidationError as error:
        raise MonitorError(f"{run}: the description in the recording is damaged") from error
    cell = _cell(recording.header, description, configs)
    monitor = Monitor(cell, silence, lockstep=recording.header.lockstep)
    monitor.differ(differences(cell, description, partial(_asset, recording.header)))
    monitor.differ(f"the recording was changed: {place}" for place in verify(recording).breaks)
    newest: dict[str, Sample] = {}
    for _, item in recording.items("/robots/", "/gate/link"):
        if isinstance(item, Step):
            change: Any = item.event  # of a link; the monitor does not import its type
            monitor.link(change.robot, ended=change.state != "ready")
        elif isinstance(item, RobotState) and (sample := sample_of(item.entry)) is not None:
            if not _repeats(newest.get(sample.robot), sample):
                monitor.take(sample)
            newest[sample.robot] = sample
    monitor.absent()
    if not monitor.account.states:
        raise MonitorError(f"{run}: holds no state of any robot; nothing was checked")
    return cell, monitor.account


def _repeats(before: Sample | None, sample: Sample) -> bool:
    """Return True if a state is recorded once more at the same tick, as it is when a link changes."""
    if before is None or (before.tick, before.time) != (sample.tick, sample.time):
        return False
    positions = ((one.q, one.setpoint, one.stop_end) for one in (before, sample))
    return all(np.array_equal(a, b) for a, b in zip(*positions, strict=True))


def _cell(header: Header, description: Description, configs: Sequence[Path]) -> Cell:
    orders = orders_of(description)
    if configs:
        return build(read_files(configs), orders)
    with TemporaryDirectory(prefix="armgate-monitor-") as folder:
        _unpack(header, Path(folder))
        try:
            return build(read_files([Path(folder) / _CONFIG], confined=True), orders)
        except DescriptionError as error:
            text = str(error).replace(f"{folder}/", "")
            raise MonitorError(f"the configuration in the recording cannot be read: {text}") from error


def _asset(header: Header, name: str) -> bytes:
    """Return what the description of a recording names by its hash."""
    try:
        return header.asset(name)
    except KeyError as error:
        raise DescriptionError(f"the recording does not hold the described URDF {name[:12]}…") from error
    except ValueError as error:
        text = f"the recording holds another URDF than the described one, {name[:12]}…"
        raise DescriptionError(text) from error


def _unpack(header: Header, folder: Path) -> None:
    """Write the files of a recording into an empty folder."""
    if len(header.files) > MAX_FILES or sum(map(len, header.files.values())) > MAX_BYTES:
        raise MonitorError(f"the recording holds more than {MAX_FILES} files or {MAX_BYTES} bytes of them")
    for name in header.files:
        if Path(name).name != name or name in {"", ".", ".."} or "\0" in name:
            raise MonitorError(f"the recording holds a file called {name!r:.80}; expected a plain name")
        try:
            (folder / name).write_bytes(header.file(name))
        except (binascii.Error, ValueError, OSError) as error:
            raise MonitorError(f"the file {name:.80} in the recording is damaged: {error}") from error

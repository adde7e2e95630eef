"""Offline monitor: checks every state of a recording."""

import binascii
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from armgate.client import Description
from armgate.monitor.description_check import differences, joint_orders
from armgate.monitor.errors import DescriptionError, MonitorError
from armgate.monitor.findings import Summary
from armgate.monitor.model import Cell, build
from armgate.monitor.monitor import Monitor
from armgate.monitor.tick_state import state_of_entry
from armgate.monitor.yaml_files import read_files
from armgate.recording import Header, Recording, RobotState, Step
from armgate.recording.verify import verify

MAX_FILES = 256
MAX_BYTES = 256 << 20
_CONFIG = "config.yaml"


def check_recording(run: Path, configs: Sequence[Path], silence: float) -> tuple[Cell, Summary]:
    """Check every state of a recording.

    Args:
        run: Its folder, or one of its files.
        configs: The configuration to check against; if empty, that of the recording.
        silence: Time without a state after which a robot counts as silent, s.

    Raises:
        RecordingError: It is not a recording, or it is damaged or incomplete.
        MonitorError: Its configuration cannot be read.
    """
    recording = Recording.open(run)
    try:
        description = recording.description
    except ValidationError as error:
        raise MonitorError(f"{run}: the description in the recording is damaged") from error
    cell = _cell(recording.header, description, configs)
    monitor = Monitor(cell, silence, lockstep=recording.header.lockstep)
    monitor.add_differences(differences(cell, description, partial(_asset, recording.header)))
    monitor.add_differences(f"the recording was changed: {place}" for place in verify(recording).breaks)
    for _, item in recording.items("/robots/", "/gate/link"):
        if isinstance(item, Step):
            change: Any = item.event  # a LinkChange, whose type the monitor does not import
            monitor.set_link(change.robot, ended=change.state != "ready")
        elif isinstance(item, RobotState) and (state := state_of_entry(item.entry)) is not None:
            if monitor.is_newest_tick(state):
                monitor.check_again(state)
            else:
                monitor.check(state)
    monitor.add_unseen()
    if not monitor.summary.states:
        raise MonitorError(f"{run}: holds no state of any robot; nothing was checked")
    return cell, monitor.summary


def _cell(header: Header, description: Description, configs: Sequence[Path]) -> Cell:
    orders = joint_orders(description)
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
    """Return the file that the description of a recording refers to by this hash."""
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

"""Start of a recording: the recorder that a configuration asks for, and its folder."""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from armgate.cell.config import CellConfig, LockstepClockConfig
from armgate.daemon.recording.inline_recorder import InlineRecorder
from armgate.daemon.recording.recorder import Recorder
from armgate.recorder.signer import SignerError, load_signer
from armgate.recording import Header
from armgate.recording.chain import Signer
from armgate.recording.reader import PATTERN


class RecorderError(Exception):
    """Run that cannot be recorded; no robot was moved."""

    exit_code = 2


def recorder_of(config: CellConfig, folder: Path | None) -> Recorder | None:
    """Return the recorder that is configured or requested; None if the run is not recorded.

    Args:
        config: The cell's configuration.
        folder: Folder to record into; None: the configured one.

    Raises:
        RecorderError: The folder holds a recording, or the signing key cannot be used.
    """
    own = config.recording
    if folder is None:
        if own.folder is None:
            if own.required:
                text = "recording.required: no folder is given; expected recording.folder or --record DIR"
                raise RecorderError(text)
            return None
        now = datetime.now().astimezone().strftime("%Y-%m-%d_%H-%M-%S")
        folder = config.file(("recording", "folder"), own.folder) / now
    if next(folder.glob(PATTERN), None) is not None:
        raise RecorderError(f"{folder}: holds a recording already; expected a folder without a recording")
    signer = None if own.sign is None else _signer(config.file(("recording", "sign"), own.sign))
    kind = InlineRecorder if isinstance(config.clock, LockstepClockConfig) else Recorder
    return kind(folder, required=own.required, rotate=own.rotate, limit=own.queue, signer=signer)


def _signer(file: Path) -> Signer:
    try:
        return load_signer(file)
    except SignerError as error:
        raise RecorderError(f"recording.sign: {error}") from error


def begin(recorder: Recorder, header: Header, now: Callable[[], float]) -> None:
    """Create the first file and begin to write.

    Raises:
        RecorderError: It cannot be created.
    """
    try:
        recorder.begin(header, now)
    except OSError as error:
        text = f"{recorder.folder}: cannot record into this folder: {error.strerror or error}"
        raise RecorderError(text) from error

"""Supervision of the flight recorder while the daemon runs: lost records cause warnings, or a stop."""

from collections.abc import Callable

from armgate.cell.cell import Cell
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.start import begin
from armgate.links.log import Log
from armgate.recorder.header import header_of
from armgate.world.core import Core
from armgate.world.states import Observer


class Recording:
    """Recording of one run; it may be switched off.

    Args:
        recorder: Records the run; None: nothing is recorded.
        log: Receives failures, and is recorded.
    """

    def __init__(self, recorder: Recorder | None, log: Log) -> None:
        self._recorder = recorder
        self._log = log
        self._trouble_logged = False

    @property
    def observers(self) -> list[Observer]:
        """Observers of the states."""
        return [] if self._recorder is None else [self._recorder.show]

    @property
    def depth(self) -> dict[str, int]:
        """Number of records that wait to be written, by the name of their queue."""
        return {} if self._recorder is None else {"recorder": self._recorder.depth}

    def begin(self, cell: Cell, start: str, lockstep: bool, now: Callable[[], float]) -> None:
        """Create the first file and begin to write.

        Raises:
            RecorderError: It cannot be created.
        """
        if self._recorder is not None:
            begin(self._recorder, header_of(cell, start, lockstep, now()), now)
            self._log.copy_to(self._recorder.log)

    def check(self, core: Core, running: bool) -> None:
        """Add a warning to the states if records were lost; stop the robots if the run must be recorded."""
        recorder = self._recorder
        if recorder is None or (trouble := recorder.trouble) is None:
            return
        if not self._trouble_logged:
            self._trouble_logged = True
            self._log.error("recording", text=trouble)
        core.warn("recording", trouble)
        if recorder.required and running:
            core.stop_all(f"the run cannot be recorded: {trouble}", again=False)

    def close(self) -> bool:
        """Close the recording; return False if it failed. Some disks report only here that they are full."""
        recorder = self._recorder
        if recorder is None:
            return True
        self._log.copy_to(None)
        recorder.close()
        if recorder.seal is not None:
            self._log.info("recording.closed", folder=str(recorder.folder), sha256=recorder.seal.digest.hex())
        if recorder.ended_early or (recorder.required and recorder.trouble):
            self._log.error("recording", text=recorder.trouble)
            return False
        return True

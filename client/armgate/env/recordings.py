"""Recordings of episodes, each in a folder of its own."""

from pathlib import Path

from armgate.recorder import WorldRecorder


class Recordings:
    """Folders ``episode-000001``, … in one folder, which several processes may share.

    Args:
        folder: The folder; created if it does not exist.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number = 0
        self._recorder: WorldRecorder | None = None

    def begin(self) -> WorldRecorder:
        """Return the recorder of a new episode.

        Raises:
            OSError: The folder cannot be created.
        """
        self._recorder = WorldRecorder(self._next_folder())
        return self._recorder

    def close(self) -> None:
        """Close the current recording, if there is one."""
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            recorder.close()

    def _next_folder(self) -> Path:
        self._folder.mkdir(parents=True, exist_ok=True)
        while True:
            self._number += 1
            folder = self._folder / f"episode-{self._number:06d}"
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            return folder

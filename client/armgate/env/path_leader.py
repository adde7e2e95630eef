"""Leader that plays a path file, as ``armgate lead`` does."""

from pathlib import Path

from armgate.apps.lead.drive import PathProgram, bounds_of, check_path
from armgate.apps.lead.path import read_path
from armgate.apps.lead.playback import Playback
from armgate.client.program import Program, ProgramContext


class PathLeader:
    """Maker of programs that play a path, for ``programs`` of `CellEnv`.

    Args:
        file: Path file.

    Raises:
        PathError: The file cannot be read or is malformed.
    """

    def __init__(self, file: Path) -> None:
        self._path = read_path(file)

    def __call__(self, context: ProgramContext) -> Program:
        """Return a program that plays the path from its start.

        Raises:
            UsageError: The cell has no such robot.
            PathError: The path is not one of this robot.
        """
        described = check_path(self._path, context.cell.description, context.robot or "")
        return PathProgram(Playback(self._path, bounds_of(described)), _ignore)


def _ignore(_text: str) -> None:
    """Print nothing."""

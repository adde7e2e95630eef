"""Bounded reading of regular files; devices are rejected, because reading them may never end."""

from dataclasses import dataclass
from pathlib import Path

from armgate.monitor.errors import DescriptionError


@dataclass(frozen=True)
class Located:
    """Path of a file as written, and the folder to which a relative path refers.

    ``confined``: the path must be the plain name of a file in the folder, as in a recording.
    """

    text: str
    folder: Path
    confined: bool = False

    @property
    def path(self) -> Path:
        """The file.

        Raises:
            DescriptionError: It is not in the required folder.
        """
        if self.confined and (Path(self.text).name != self.text or self.text in {"", ".", ".."}):
            raise DescriptionError(f"{self.text!r:.80} is not a file of the recording")
        return self.folder / self.text

    def beside(self, text: str) -> "Located":
        """Return another file that this one refers to."""
        return Located(text, self.path.parent, self.confined)


def read_bytes(file: Path, most: int, what: str) -> bytes:
    """Return the content of a regular file.

    Raises:
        DescriptionError: It cannot be read, is not a regular file, or is larger than ``most`` bytes.
    """
    try:
        if file.exists() and not file.is_file():
            raise DescriptionError(f"{what}{file}: not a regular file")
        with file.open("rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise DescriptionError(
            f"{what}{file}: cannot be read: {getattr(error, 'strerror', error)}"
        ) from error
    if len(data) > most:
        raise DescriptionError(f"{what}{file}: more than {most} bytes")
    return data

"""Reader of a recording: a folder of parts, or one file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import to_json

from armgate.protocol import messages as m
from armgate.recording import codec
from armgate.recording.errors import (
    DamagedError,
    ForeignError,
    IncompleteError,
    TruncatedError,
    first_problem,
)
from armgate.recording.header import Header
from armgate.recording.scan import ChunkPosition, ChunkReader, scan
from armgate.recording.topics import GAP, RUN

PATTERN = "recording-*.mcap"
_NS = 1_000_000_000


def part_name(number: int) -> str:
    """Return the file name of a part of a recording."""
    return f"recording-{number:04d}.mcap"


def parts_of(path: Path) -> list[Path]:
    """Return the files of a recording in order: all in a folder, or the one file named.

    Raises:
        ForeignError: The path does not exist, or the folder holds no recording.
    """
    if path.is_dir():
        found = sorted(path.glob(PATTERN))
        if not found:
            raise ForeignError(path, f"holds no recording; expected files {PATTERN}")
        return found
    if not path.exists():
        raise ForeignError(path, "no such file or folder; expected a recording")
    return [path.resolve()]  # a symbolic link is followed if the user names it, but not inside a folder


@dataclass(frozen=True, slots=True)
class Part:
    """One file of a recording, ready to be read."""

    file: Path
    header: Header
    chunks: tuple[ChunkPosition, ...]
    reader: ChunkReader
    closed: bool
    lost: int
    """Number of bytes at the end that do not form a complete record."""


class Recording:
    """Recording opened by ``Recording.open``.

    Attributes:
        path: The folder or file that was opened.
        header: Header of the first part.
        parts: Files of the recording, in order.
    """

    def __init__(self, path: Path, parts: Sequence[Part]) -> None:
        self.path = path
        self.parts = tuple(parts)
        self.header = parts[0].header

    @classmethod
    def open(cls, path: Path, *, partial: bool = False) -> "Recording":
        """Open a folder or a file.

        Args:
            path: The folder or file.
            partial: Accept an incomplete recording (the daemon was killed, or is still writing).

        Raises:
            RecordingError: The path is not a recording, the format is newer, a file is damaged or incomplete,
                or a part is missing.
            OSError: A file cannot be read.
        """
        files = parts_of(path)
        parts = [part for part in map(_part, files) if part is not None]
        if not parts:
            raise TruncatedError(files[0], "ends before its first record; nothing can be recovered")
        _check_sequence(path, parts)
        if not partial:
            _check_ends(parts, files)
        return cls(path, parts)

    @property
    def whole(self) -> bool:
        """True if every file was closed."""
        return all(part.closed for part in self.parts)

    @cached_property
    def description(self) -> m.Description:
        """Description of the cell, as sent to clients.

        Raises:
            DamagedError: The description in the header is damaged.
        """
        try:
            found = m.Description.model_validate_json(to_json(self.header.description))
        except ValidationError as error:
            raise DamagedError(self.path, f"its description of the cell: {first_problem(error)}") from error
        if not found.robots:
            raise DamagedError(self.path, "its description of the cell names no robot")
        return found

    def messages(self) -> Iterator[tuple[str, float, bytes]]:
        """Yield topic, daemon time [s] and data of every message, in the order of the events.

        Raises:
            DamagedError: A chunk is damaged.
        """
        for part in self.parts:
            for place in part.chunks:
                for topic, ns, data in part.reader.messages(place):
                    yield topic, (ns - self.header.origin_ns) / _NS, data

    def items(self, *topics: str) -> Iterator[tuple[float, codec.Item]]:
        """Yield daemon time [s] and item of every message whose topic begins with one of ``topics``.

        Without ``topics``, yield the items of all messages.

        Raises:
            DamagedError: A message is damaged.
        """
        for topic, time, data in self.messages():
            if topic == RUN or (topics and not topic.startswith(topics)):
                continue
            item = read_item(self.path, topic, data)
            if item is not None:
                yield time, item

    def steps(self) -> Iterator[tuple[float, codec.Step]]:
        """Yield the daemon time [s] of every event of the gate, and the event with its outputs.

        Raises:
            IncompleteError: The recorder lost events here, or the first part is missing.
            DamagedError: A message is damaged.
        """
        if self.header.part != 1:
            text = f"begins with part {self.header.part}; a replay of the gate's events needs part 1"
            raise IncompleteError(self.path, text)
        for time, item in self.items("/gate/", GAP):
            if isinstance(item, codec.Step):
                yield time, item
            elif isinstance(item, codec.Gap) and item.steps:
                text = (
                    f"{item.steps} of the gate's events were lost at {time:.3f} s; a replay cannot continue"
                )
                raise IncompleteError(self.path, text)


def read_item(file: Path, topic: str, data: bytes) -> codec.Item | None:
    """Return the item in a message; None if a later version of armgate added its topic.

    Raises:
        DamagedError: The message does not have the form of its topic.
    """
    try:
        return codec.decode(topic, data)
    except ValueError as error:
        raise DamagedError(file, str(error)) from error


def check_entry(file: Path, description: m.Description, entry: m.Entry) -> None:
    """Check that an entry fits a robot of the cell.

    Raises:
        DamagedError: The cell has no such robot, or the robot has another number of joints.
    """
    robot = next((robot for robot in description.robots if robot.name == entry.robot), None)
    if robot is None:
        raise DamagedError(file, f"holds a state of {entry.robot!r}; its cell has no such robot")
    for name, values in (("q", entry.q), ("setpoint", entry.setpoint)):
        if values is not None and len(values) != len(robot.joints):
            text = f"holds a state of {entry.robot} with {len(values)} numbers as {name}"
            raise DamagedError(file, f"{text}; expected {len(robot.joints)}")


def _part(file: Path) -> Part | None:
    """Return one file; None if it ends before its header."""
    found = scan(file)
    if not found.chunks:
        return None
    reader = ChunkReader(found.chunks[0])
    topic, _, data = next(iter(reader.messages(found.chunks[0])), ("", 0, b""))
    if topic != RUN:
        raise DamagedError(file, "does not begin with the header of a recording")
    try:
        header = Header.model_validate_json(data)
    except ValidationError as error:
        raise DamagedError(file, f"its header: {first_problem(error)}") from error
    return Part(file, header, found.chunks, reader, found.closed, found.size - found.good)


def _check_sequence(path: Path, parts: Sequence[Part]) -> None:
    first = parts[0].header
    for number, part in enumerate(parts, first.part):
        other = part.header
        if (other.start, other.hash) != (first.start, first.hash):
            text = f"not of the same run as {parts[0].file.name}: cell {other.cell!r}, start {other.start!r}"
            raise IncompleteError(part.file, f"{text}; keep one run in a folder")
        if other.part != number:
            raise IncompleteError(path, f"part {number} is missing; expected {part_name(number)}")


def _check_ends(parts: Sequence[Part], files: Sequence[Path]) -> None:
    for part in parts:
        if not part.closed:
            whole = part.file.stat().st_size - part.lost
            why = "the daemon was killed, the disk was full, or the file is still being written"
            text = f"incomplete after {whole} bytes: {why}; run: armgate recover {part.file}"
            raise TruncatedError(part.file, text)
    known = {part.file for part in parts}
    if empty := [file for file in files if file not in known]:
        text = f"incomplete before its header; run: armgate recover {empty[0].parent}"
        raise TruncatedError(empty[0], text)

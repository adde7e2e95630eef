"""Reads a recording: a folder of parts, or one file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pydantic import ValidationError
from pydantic_core import to_json

from armgate.protocol import messages as m
from armgate.recording import codec, form
from armgate.recording.errors import (
    DamagedError,
    ForeignError,
    IncompleteError,
    TruncatedError,
    first_problem,
)
from armgate.recording.scan import Chunks, Place, scan

PATTERN = "recording-*.mcap"
_NS = 1_000_000_000


def part_name(number: int) -> str:
    """The name of the file that is this part of a recording."""
    return f"recording-{number:04d}.mcap"


def parts_of(path: Path) -> list[Path]:
    """The files of a recording in order, from its folder, or just the one that is named.

    Raises:
        ForeignError: There is no such file, or the folder has none.
    """
    if path.is_dir():
        found = sorted(path.glob(PATTERN))
        if not found:
            raise ForeignError(path, f"holds no recording; expected files {PATTERN}")
        return found
    if not path.exists():
        raise ForeignError(path, "there is no such file or folder; expected a recording")
    return [path.resolve()]  # a link that the user names is followed, one within a folder is not


@dataclass(frozen=True, slots=True)
class Part:
    """One file, ready to be read."""

    file: Path
    header: form.Header
    chunks: tuple[Place, ...]
    reader: Chunks
    closed: bool
    lost: int
    """Bytes at its end that are no whole record."""


class Recording:
    """A recording that is read; made by ``Recording.open``.

    Attributes:
        path: What was opened.
        header: What it is of.
        parts: Its files.
    """

    def __init__(self, path: Path, parts: Sequence[Part]) -> None:
        self.path = path
        self.parts = tuple(parts)
        self.header = parts[0].header

    @classmethod
    def open(cls, path: Path, *, partial: bool = False) -> "Recording":
        """Opens a folder or a file.

        Args:
            path: Which.
            partial: Whether it may break off (the daemon was killed, or writes it still).

        Raises:
            RecordingError: It is none, of a later format, damaged, breaks off, or a part is missing.
            OSError: It cannot be read.
        """
        files = parts_of(path)
        parts = [part for part in map(_part, files) if part is not None]
        if not parts:
            raise TruncatedError(files[0], "breaks off before anything was written; nothing can be recovered")
        _check_sequence(path, parts)
        if not partial:
            _check_ends(parts, files)
        return cls(path, parts)

    @property
    def whole(self) -> bool:
        """Whether all of it was closed in order."""
        return all(part.closed for part in self.parts)

    @cached_property
    def description(self) -> m.Description:
        """What clients are told of the cell.

        Raises:
            DamagedError: It is not what was written.
        """
        try:
            found = m.Description.model_validate_json(to_json(self.header.description))
        except ValidationError as error:
            raise DamagedError(self.path, f"its description of the cell: {first_problem(error)}") from error
        if not found.robots:
            raise DamagedError(self.path, "its description of the cell names no robot")
        return found

    def messages(self) -> Iterator[tuple[str, float, bytes]]:
        """Topic, daemon time [s] and data of every message, in the order in which things happened.

        Raises:
            DamagedError: A chunk is not what was written.
        """
        for part in self.parts:
            for place in part.chunks:
                for topic, ns, data in part.reader.messages(place):
                    yield topic, (ns - self.header.origin_ns) / _NS, data

    def items(self, *topics: str) -> Iterator[tuple[float, codec.Item]]:
        """Daemon time [s] and item of every message whose topic begins with one of these; all if none.

        Raises:
            DamagedError: A message is not what was written.
        """
        for topic, time, data in self.messages():
            if topic == form.RUN or (topics and not topic.startswith(topics)):
                continue
            item = read_item(self.path, topic, data)
            if item is not None:
                yield time, item

    def steps(self) -> Iterator[tuple[float, codec.Step]]:
        """Daemon time [s] of every event of the gate, and the event with its outputs.

        Raises:
            IncompleteError: The recorder lost some here, or the recording does not begin at its beginning.
            DamagedError: A message is not what was written.
        """
        if self.header.part != 1:
            text = f"begins with part {self.header.part}; the gate's events are judged from part 1 on"
            raise IncompleteError(self.path, text)
        for time, item in self.items("/gate/", form.GAP):
            if isinstance(item, codec.Step):
                yield time, item
            elif isinstance(item, codec.Gap) and item.steps:
                text = f"{item.steps} of the gate's events were lost at {time:.3f} s; no replay goes beyond"
                raise IncompleteError(self.path, text)


def read_item(file: Path, topic: str, data: bytes) -> codec.Item | None:
    """The item in a message, None if it is of a kind that was added later.

    Raises:
        DamagedError: It is not what stands on that topic.
    """
    try:
        return codec.decode(topic, data)
    except ValueError as error:
        raise DamagedError(file, str(error)) from error


def check_entry(file: Path, description: m.Description, entry: m.Entry) -> None:
    """Refuse the entry of a robot that the cell has not.

    Raises:
        DamagedError: There is no such robot, or it has another number of joints.
    """
    robot = next((robot for robot in description.robots if robot.name == entry.robot), None)
    if robot is None:
        raise DamagedError(file, f"holds a state of {entry.robot!r}, which its cell has not")
    for name, values in (("q", entry.q), ("setpoint", entry.setpoint)):
        if values is not None and len(values) != len(robot.joints):
            text = f"holds a state of {entry.robot} with {len(values)} numbers as {name}"
            raise DamagedError(file, f"{text}; expected {len(robot.joints)}")


def _part(file: Path) -> Part | None:
    """One file; None if it breaks off before its header."""
    found = scan(file)
    if not found.chunks:
        return None
    reader = Chunks(found.chunks[0])
    topic, _, data = next(iter(reader.messages(found.chunks[0])), ("", 0, b""))
    if topic != form.RUN:
        raise DamagedError(file, "does not begin with the header of a recording")
    try:
        header = form.Header.model_validate_json(data)
    except ValidationError as error:
        raise DamagedError(file, f"its header: {first_problem(error)}") from error
    return Part(file, header, found.chunks, reader, found.closed, found.size - found.good)


def _check_sequence(path: Path, parts: Sequence[Part]) -> None:
    first = parts[0].header
    for number, part in enumerate(parts, first.part):
        other = part.header
        if (other.start, other.hash) != (first.start, first.hash):
            text = f"is of another run than {parts[0].file.name}: cell {other.cell!r}, start {other.start!r}"
            raise IncompleteError(part.file, f"{text}; keep one run in a folder")
        if other.part != number:
            raise IncompleteError(path, f"part {number} is missing; expected {part_name(number)}")


def _check_ends(parts: Sequence[Part], files: Sequence[Path]) -> None:
    for part in parts:
        if not part.closed:
            whole = part.file.stat().st_size - part.lost
            why = "its daemon was killed, its disk was full, or it is still being written"
            text = f"breaks off after {whole} bytes: {why}; run: armgate recover {part.file}"
            raise TruncatedError(part.file, text)
    known = {part.file for part in parts}
    if empty := [file for file in files if file not in known]:
        text = f"breaks off before its header; run: armgate recover {empty[0].parent}"
        raise TruncatedError(empty[0], text)

"""Recordings of a daemon: written by the daemon, read by replays, reports and viewers.

A recording is a folder of MCAP files (``recording-0001.mcap``, …), each readable by itself, with messages in
JSON. ``Recording`` reads a recording, ``StateSeries`` returns its states at any time, ``RecordingWriter``
writes one file.
"""

from armgate.recording.codec import CellState, Gap, Item, LogLine, RobotState, Step
from armgate.recording.errors import (
    DamagedError,
    ForeignError,
    IncompleteError,
    NewerFormatError,
    RecordingError,
    TruncatedError,
)
from armgate.recording.header import FORMAT, Header, machine, software
from armgate.recording.reader import Recording, part_name, parts_of
from armgate.recording.state_series import StateSeries
from armgate.recording.writer import RecordingWriter

__all__ = [
    "FORMAT",
    "CellState",
    "DamagedError",
    "ForeignError",
    "Gap",
    "Header",
    "IncompleteError",
    "Item",
    "LogLine",
    "NewerFormatError",
    "Recording",
    "RecordingError",
    "RecordingWriter",
    "RobotState",
    "StateSeries",
    "Step",
    "TruncatedError",
    "machine",
    "part_name",
    "parts_of",
    "software",
]

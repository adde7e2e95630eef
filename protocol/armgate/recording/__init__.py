"""The form of a recording: what a daemon writes, and what replays, reports and viewers read.

A recording is a folder of MCAP files (``recording-0001.mcap``, …), each readable by itself, with messages in
JSON. ``Recording`` reads one, ``StateSeries`` shows its states at any time, ``Sink`` writes one file.
"""

from armgate.recording.codec import Gap, Item, LogLine, Moment, Shown, Step
from armgate.recording.errors import (
    DamagedError,
    ForeignError,
    IncompleteError,
    NewerFormatError,
    RecordingError,
    TruncatedError,
)
from armgate.recording.form import FORMAT, Header
from armgate.recording.machine import machine, software
from armgate.recording.reader import Recording, part_name, parts_of
from armgate.recording.series import StateSeries
from armgate.recording.sink import Sink

__all__ = [
    "FORMAT",
    "DamagedError",
    "ForeignError",
    "Gap",
    "Header",
    "IncompleteError",
    "Item",
    "LogLine",
    "Moment",
    "NewerFormatError",
    "Recording",
    "RecordingError",
    "Shown",
    "Sink",
    "StateSeries",
    "Step",
    "TruncatedError",
    "machine",
    "part_name",
    "parts_of",
    "software",
]

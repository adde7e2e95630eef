"""Recorded paths: text files of joint positions over time, read strictly and interpolated smoothly.

Format (every line below is required, in this order; further comment lines may follow the first)::

    # armgate path 1
    # robot: GR
    # joints: X Y Z A1 A2 A3 A4 A5 A6
    # units: m m m deg deg deg deg deg deg
    # sample time: 0.048
    t,X,Y,Z,A1,A2,A3,A4,A5,A6
    0.000,2.930000,…

Times are in s, begin at 0, and are one sample time apart; units are m, rad or deg. In memory, angles are in
rad.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import PathError

Array = NDArray[np.float64]

MAGIC = "# armgate path 1"
MAX_SAMPLES = 1_000_000
_KEYS = ("robot", "joints", "units", "sample time")
MAX_BYTES = 256 * 1024 * 1024
"""Largest size of a path file, bytes: room for MAX_SAMPLES."""

_UNITS = {"m": 1.0, "rad": 1.0, "deg": math.pi / 180.0}


@dataclass(frozen=True)
class RecordedPath:
    """Joint positions of one robot, one sample time apart, at rest at both ends.

    Between samples the position is interpolated by cubic Hermite pieces with the slopes of Fritsch and
    Carlson (SIAM J. Numer. Anal. 17 (1980) 238–246): once continuously differentiable, and always within the
    range of the two neighbouring samples. So a path is within the joint limits everywhere if
    its samples are.

    Attributes:
        file: The path file.
        robot: Name of the robot that the path was recorded with.
        joints: Joint names, in the order of the columns.
        units: ``m`` or ``rad`` for each joint.
        period: Sample time, s.
        q: Samples (m, n), m or rad, read-only.
        first_line: Line of the file that holds sample 0.
    """

    file: Path
    robot: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    period: float
    q: Array
    first_line: int
    _slopes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.q.setflags(write=False)
        object.__setattr__(self, "_slopes", slopes(self.q, self.period))

    @property
    def duration(self) -> float:
        """Time of the last sample, s."""
        return (len(self.q) - 1) * self.period

    def at(self, t: float) -> Array:
        """Return the position at time ``t`` (n,); the path rests before its start and after its end."""
        return self._piece(t, _POSITION)

    def velocity(self, t: float) -> Array:
        """Return the velocity at time ``t`` (n,), per s."""
        if not 0.0 <= t <= self.duration:
            return np.zeros(self.q.shape[1])
        return self._piece(t, _VELOCITY) / self.period

    def _piece(self, t: float, basis: Array) -> Array:
        u = min(max(t, 0.0), self.duration) / self.period
        i = min(int(u), len(self.q) - 2)
        s = u - i
        left, right, leaves, arrives = (basis @ np.array([1.0, s, s * s, s * s * s])).tolist()
        ends = *self.q[i : i + 2].tolist(), *self._slopes[i : i + 2].tolist()
        return np.array(
            [
                left * a + right * b + self.period * (leaves * da + arrives * db)
                for a, b, da, db in zip(*ends, strict=True)
            ]
        )

    def line_of(self, sample: int) -> int:
        """Return the line of the file that holds a sample."""
        return self.first_line + sample


# Cubic Hermite basis: rows weigh left value, right value, left slope, right slope; columns are powers of s.
_POSITION = np.array([[1.0, 0, -3, 2], [0, 0, 3, -2], [0, 1, -2, 1], [0, 0, -1, 1]])
_VELOCITY = np.array([[0.0, -6, 6, 0], [0, 6, -6, 0], [1, -4, 3, 0], [0, -2, 3, 0]])


def slopes(q: Array, period: float) -> Array:
    """Return Fritsch and Carlson's slopes: the harmonic mean of both sides; zero at extrema and ends."""
    secant = np.diff(q, axis=0) / period
    left, right = secant[:-1], secant[1:]
    same = left * right > 0.0
    total = np.where(same, left + right, 1.0)
    inner = np.where(same, 2.0 * left * (right / total), 0.0)
    rest = np.zeros((1, q.shape[1]))
    return np.concatenate([rest, inner, rest])


def read_path(file: Path) -> RecordedPath:
    """Read a path file.

    Raises:
        PathError: The file cannot be read or is malformed; the text names file, line and expectation.
    """
    try:
        with file.open("rb") as stream:  # a device file has no end
            data = stream.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise PathError(file, None, f"has more than {MAX_BYTES} bytes; expected a path file")
        lines = data.decode("utf-8").splitlines()
    except OSError as error:
        raise PathError(file, None, f"cannot be read ({error.strerror}); expected a path file") from error
    except UnicodeDecodeError as error:
        raise PathError(file, None, "is not text; expected a path file in UTF-8") from error
    header, columns_at = _header(file, lines)
    joints, units, period = _meaning(file, header)
    expected = ",".join(("t", *joints))
    if columns_at >= len(lines) or lines[columns_at].strip() != expected:
        raise PathError(file, columns_at + 1, f"expected the column line {expected!r}")
    q = _samples(file, lines, columns_at + 1, len(joints), period)
    q *= [_UNITS[unit] for unit in units]
    inside = tuple("m" if unit == "m" else "rad" for unit in units)
    return RecordedPath(file, header["robot"][1], joints, inside, period, q, columns_at + 2)


def format_path(robot: str, joints: Sequence[tuple[str, str]], period: float, q: Array) -> str:
    """Return the text of a path file.

    Args:
        robot: Name of the robot.
        joints: Name and unit (m or rad) of each joint.
        period: Sample time, s.
        q: Samples (k, n), m or rad; a single sample is written twice, since a path has two ends.
    """
    names, units = zip(*joints, strict=True)
    head = [MAGIC, f"# robot: {robot}", f"# joints: {' '.join(names)}", f"# units: {' '.join(units)}"]
    head += [f"# sample time: {period:g}", ",".join(("t", *names))]
    samples = q if len(q) > 1 else np.repeat(q, 2, axis=0)
    rows = [
        ",".join((f"{k * period:.6f}", *(f"{value:.9f}" for value in row))) for k, row in enumerate(samples)
    ]
    return "\n".join([*head, *rows]) + "\n"


def _header(file: Path, lines: list[str]) -> tuple[dict[str, tuple[int, str]], int]:
    """Return the header's values with their lines, and the index of the first line after the header."""
    if not lines or lines[0].strip() != MAGIC:
        raise PathError(file, 1, f"expected {MAGIC!r} as the first line")
    found: dict[str, tuple[int, str]] = {}
    index = 1
    while index < len(lines) and lines[index].startswith("#"):
        key, colon, value = lines[index][1:].partition(":")
        if colon and key.strip() in _KEYS:
            if key.strip() in found:
                raise PathError(file, index + 1, f"{key.strip()!r} appears twice in the header")
            found[key.strip()] = (index + 1, value.strip())
        index += 1
    for key in _KEYS:
        if not found.get(key, (0, ""))[1]:
            raise PathError(file, index + 1, f"the header lacks '# {key}: …'")
    return found, index


def _meaning(
    file: Path, header: dict[str, tuple[int, str]]
) -> tuple[tuple[str, ...], tuple[str, ...], float]:
    """Return joint names, units and sample time."""
    line, text = header["joints"]
    joints = tuple(text.split())
    if len(set(joints)) != len(joints):
        raise PathError(file, line, "a joint appears twice")
    line, text = header["units"]
    units = tuple(text.split())
    if len(units) != len(joints):
        raise PathError(file, line, f"{len(units)} units for {len(joints)} joints; expected one for each")
    for unit in units:
        if unit not in _UNITS:
            raise PathError(file, line, f"unit {unit!r}; expected one of {', '.join(_UNITS)}")
    line, text = header["sample time"]
    period = _number(file, line, "sample time", text)
    if not 1e-4 <= period <= 10.0:
        raise PathError(file, line, f"sample time {text} s; expected 0.0001 to 10 s")
    return joints, units, period


def _samples(file: Path, lines: list[str], start: int, n: int, period: float) -> Array:
    """Return the positions in the table (m, n), in the file's units."""
    if not 2 <= len(lines) - start <= MAX_SAMPLES:
        raise PathError(file, len(lines), f"{len(lines) - start} samples; expected 2 to {MAX_SAMPLES}")
    rows = np.empty((len(lines) - start, n))
    for i, text in enumerate(lines[start:]):
        line = start + i + 1
        cells = text.split(",")
        if len(cells) != n + 1:
            raise PathError(file, line, f"{len(cells)} columns; expected {n + 1}")
        t, *position = (_number(file, line, f"column {c + 1}", cell) for c, cell in enumerate(cells))
        if abs(t - i * period) > 0.01 * period:
            raise PathError(
                file, line, f"time {t:g} s; expected {i * period:g} s, one sample time after the last"
            )
        rows[i] = position
    return rows


def _number(file: Path, line: int, what: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise PathError(file, line, f"{what}: {text.strip()!r} is not a number") from None
    if not math.isfinite(value):
        raise PathError(file, line, f"{what}: {text.strip()} is not finite")
    return value

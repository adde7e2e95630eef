"""Path files are read strictly and interpolated smoothly."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from armgate.apps.errors import PathError
from armgate.apps.lead import path as path_module
from armgate.apps.lead.path import RecordedPath, read_path

GOOD = [
    "# armgate path 1",
    "# robot: GR",
    "# joints: X A1",
    "# units: m deg",
    "# sample time: 0.1",
    "# a note: with a colon",
    "t,X,A1",
    "0,1.0,0",
    "0.1,1.1,90",
    "0.2,1.2,180",
]


def written(folder: Path, lines: list[str]) -> Path:
    file = folder / "path.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def test_a_good_file(tmp_path: Path) -> None:
    path = read_path(written(tmp_path, GOOD))
    assert (path.robot, path.joints, path.units) == ("GR", ("X", "A1"), ("m", "rad"))
    assert path.duration == pytest.approx(0.2)
    np.testing.assert_allclose(path.at(0.1), [1.1, np.pi / 2])
    assert path.line_of(0) == 8


def changed(line: int, text: str) -> list[str]:
    return [text if i == line - 1 else old for i, old in enumerate(GOOD)]


@pytest.mark.parametrize(
    ("lines", "line", "expected"),
    [
        ([], 1, "first line"),
        (changed(1, "t,X,A1"), 1, "expected '# armgate path 1'"),
        (GOOD[:1] + GOOD[2:], 6, "lacks '# robot: …'"),
        (changed(2, "# robot:"), 7, "lacks '# robot: …'"),
        (changed(6, "# robot: FR"), 6, "twice"),
        (changed(3, "# joints: X X"), 3, "a joint appears twice"),
        (changed(4, "# units: m"), 4, "1 units for 2 joints"),
        (changed(4, "# units: m mm"), 4, "'mm'; expected one of m, rad, deg"),
        (changed(5, "# sample time: 0"), 5, "expected 0.0001 to 10"),
        (changed(5, "# sample time: soon"), 5, "is not a number"),
        (changed(7, "t,A1,X"), 7, "expected the column line 't,X,A1'"),
        (GOOD[:6], 7, "expected the column line"),
        (GOOD[:8], 8, "1 samples; expected 2"),
        (changed(9, "0.1,1.1"), 9, "2 columns; expected 3"),
        (changed(9, "0.1,1.1,ninety"), 9, "column 3: 'ninety' is not a number"),
        (changed(9, "0.1,nan,90"), 9, "column 2: nan is not finite"),
        (changed(9, "0.1,1.1,inf"), 9, "column 3: inf is not finite"),
        (changed(9, "0.3,1.1,90"), 9, "time 0.3 s; expected 0.1 s"),
        (changed(8, "0.1,1.0,0"), 8, "expected 0 s"),
        ([*GOOD, ""], 11, "1 columns; expected 3"),
    ],
)
def test_errors_name_file_and_line(tmp_path: Path, lines: list[str], line: int, expected: str) -> None:
    file = written(tmp_path, lines)
    with pytest.raises(PathError) as caught:
        read_path(file)
    assert str(caught.value).startswith(f"{file}:{line}: ")
    assert expected in str(caught.value)
    assert (caught.value.line, caught.value.exit_code) == (line, 2)


def test_a_missing_file_and_a_binary_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PathError, match="No such file"):
        read_path(tmp_path / "none.csv")
    (tmp_path / "path.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PathError, match="not text"):
        read_path(tmp_path / "path.csv")


samples = arrays(np.float64, st.tuples(st.integers(2, 12), st.just(2)), elements=st.floats(-3, 3))


def path_of(q: np.ndarray, period: float = 0.05) -> RecordedPath:
    return RecordedPath(Path("x.csv"), "GR", ("X", "A1"), ("m", "rad"), period, q.copy(), 8)


@settings(deadline=None)
@given(samples)
def test_the_path_passes_through_its_samples_and_stays_between_neighbours(q: np.ndarray) -> None:
    path = path_of(q)
    for i, row in enumerate(q):
        np.testing.assert_allclose(path.at(i * path.period), row, atol=1e-9)
    for u in np.linspace(0, len(q) - 1, 97):
        i = min(int(u), len(q) - 2)
        low, high = np.minimum(q[i], q[i + 1]), np.maximum(q[i], q[i + 1])
        at = path.at(u * path.period)
        assert np.all(at >= low - 1e-9)
        assert np.all(at <= high + 1e-9)


@settings(deadline=None)
@given(samples, st.floats(0, 1))
def test_the_path_is_once_continuously_differentiable(q: np.ndarray, share: float) -> None:
    path = path_of(q)
    h = 1e-7
    for i in range(len(q)):  # across every sample the velocity is continuous
        t = i * path.period
        np.testing.assert_allclose(path.velocity(t - h), path.velocity(t + h), atol=1e-2)
    t = h + share * (path.duration - 2 * h)
    difference = (path.at(t + h) - path.at(t - h)) / (2 * h)
    np.testing.assert_allclose(path.velocity(t), difference, atol=1e-2)


@settings(deadline=None)
@given(samples)
def test_the_path_rests_at_both_ends_and_beyond(q: np.ndarray) -> None:
    path = path_of(q)
    for t in (0.0, path.duration, -1.0, path.duration + 1.0):
        np.testing.assert_allclose(path.velocity(t), 0.0, atol=1e-9)
    np.testing.assert_array_equal(path.at(-1.0), q[0])
    np.testing.assert_allclose(path.at(path.duration + 1.0), q[-1], atol=1e-12)


def test_samples_of_a_uniform_straight_motion_are_interpolated_linearly() -> None:
    q = np.linspace([0.0, 1.0], [1.0, -1.0], 11)
    path = path_of(q, 0.1)
    np.testing.assert_allclose(path.at(0.333), [0.333, 1.0 - 0.666], atol=1e-12)


def test_samples_cannot_be_changed() -> None:
    path = path_of(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="read-only"):
        path.q[0, 0] = 1.0


def test_a_device_file_is_refused(monkeypatch):
    monkeypatch.setattr(path_module, "MAX_BYTES", 1000)
    with pytest.raises(PathError, match="more than 1000 bytes; expected a path file"):
        read_path(Path("/dev/zero"))

"""A recorded run on the page: time slider, play and pause, and files that are refused."""

import shutil
import subprocess
from itertools import count

import numpy as np
import pytest

from support.pages import Page

from .conftest import ARMGATE, PLAIN, process

SECONDS = 4


def run(*arguments):
    return subprocess.run([*ARMGATE, *map(str, arguments)], check=False, capture_output=True, text=True)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "run"
    ended = run("demo", "--lockstep", "--duration", SECONDS, "--out", folder)
    assert ended.returncode == 0, ended.stderr
    return folder


@pytest.fixture
def page(browser, recording):
    with process("view", recording, *PLAIN, prints="armgate: view at ") as (url, viewer):
        page = Page(browser, url, "Play")
        yield page
        page.tab.close()  # an open page keeps a core busy
        viewer.terminate()
        assert viewer.wait(30) == 0


def drag_time(page, share):
    """Drag the knob of the time slider until the page shows this share of the run."""
    x, y, _ = page.slider("Time [s]")
    page.point(x, y, press=True)
    x, steps = page.along("Time [s]", share), count()

    def there():
        # All movements lead to the same place, so one that is handled late changes nothing. A busy browser
        # skips movements, hence the steps of a pixel.
        page.point(x + next(steps) % 2, y)
        return abs(share - page.time / page.length) < 0.05

    page.until(there, "the requested time")
    page.release_pointer()


@pytest.mark.slow
def test_the_time_slider_seeks_in_the_run(page):
    assert page.time == 0.0
    assert page.length > SECONDS
    start, first = page.joints("GR"), page.screenshot().astype(int)
    assert len(start) == 9
    drag_time(page, 0.7)
    page.until(lambda: page.joints("GR") != start, "the robot at another position")
    later = page.joints("GR")
    x, y, width, height = (int(value) for value in page.scene())
    page.until(lambda: changed(page, first, (x, y, width, height)) > 200, "moved robots in the picture")
    assert "leader" in page.text
    page.tab.keep("viewer-recording.png")
    drag_time(page, 0.3)
    page.until(lambda: page.joints("GR") not in (start, later), "a third position")
    drag_time(page, 0.0)
    page.until(lambda: page.joints("GR") == start, "the beginning again")


def changed(page, first, window):
    x, y, width, height = window
    seen = page.screenshot().astype(int)
    return (np.abs(seen - first).max(axis=2)[y : y + height, x : x + width] > 30).sum()


@pytest.mark.slow
def test_a_recording_is_played_to_its_end_and_paused(page):
    page.press("Play")
    page.until(lambda: page.time > 0.2, "advancing time")
    page.press("Pause")
    page.until(lambda: "Play" in page.text, "the pause")
    before = page.joints("FR")
    drag_time(page, 0.9)
    page.press("Play")
    page.until(lambda: page.time == page.length, "its end")
    page.until(lambda: "Play" in page.text, "the pause at the end")
    assert page.joints("FR") != before
    assert "STOP" not in page.text  # a recording has no robot to stop


@pytest.mark.slow
def test_an_incomplete_recording_is_refused(recording, tmp_path):
    broken = tmp_path / "recording-0001.mcap"
    shutil.copy(recording / broken.name, broken)
    with broken.open("r+b") as file:
        file.truncate(broken.stat().st_size * 2 // 3)
    (tmp_path / "notes.mcap").write_text("milk, bread")
    for arguments, status, text in (
        ((broken,), 1, "run: armgate recover"),
        ((tmp_path / "notes.mcap",), 2, "notes.mcap"),
        ((tmp_path / "nothing",), 2, "no such file or folder"),
        ((recording, "--role", "operator"), 2, "a recording: the page can only observe it"),
    ):
        ended = run("view", *arguments, *PLAIN)
        assert (ended.returncode, text in ended.stderr) == (status, True), ended.stderr
        assert "Traceback" not in ended.stderr

"""The page in a real browser: robots move, the camera sees the tool, STOP stops, a reload has no effect."""

import math
import subprocess

import numpy as np
import pytest

from armgate.apps.view import colours
from armgate.client import connect
from support.pages import Page
from support.pictures import middle_of, where

from .conftest import ARMGATE

_CONNECT_ELSEWHERE = """() => new Promise(resolve => {
document.addEventListener('securitypolicyviolation', event => resolve(event.effectiveDirective));
new WebSocket('ws://127.0.0.1:9');
})"""


@pytest.fixture(scope="module")
def page(browser, viewing):
    page = Page(browser, viewing)
    yield page
    page.tab.close()  # an open page keeps a core busy


@pytest.fixture
def tracking(address):
    """Run leader and follower; yield when the camera is on the tool."""
    commands = (
        ["follow", address, "--robot", "FR", "--leader", "GR"],
        ["lead", address, "--path", "configs/paths/inspection.csv"],
    )
    children = [subprocess.Popen([*ARMGATE, *command], stdout=subprocess.DEVNULL) for command in commands]
    try:
        with connect(address, name="observer", role="observer") as cell:
            cell.subscribe(every=4, robots=["FR"], fields=["q"])
            for state in cell.states():
                error, progress = (
                    state.signals.get(f"{name}") for name in ("follow.angle_error", "lead.progress")
                )
                if error and progress and progress.value[0] > 0.05 and error.value[0] < math.radians(1.0):
                    break
        yield children
    finally:
        for child in children:
            child.terminate()
        for child in children:
            child.wait(30)


def _tool_off_centre(page):
    """Wait for the tool in the camera picture; return its offset from the middle column, as a share."""
    column, width = page.until(lambda: _tool_column(page.picture()), "the tool in the camera's picture")
    return column / width - 0.5


def _tool_column(picture):
    """Return the tool's column and the picture's width; None if there is no picture or no tool in it."""
    if picture is None or np.count_nonzero(where(picture, colours.TOOL)) <= 5:
        return None
    return middle_of(picture, colours.TOOL)[0], picture.shape[1]


@pytest.mark.slow
def test_the_robots_move_and_the_camera_sees_the_tool_until_stop_is_pressed(page, address, tracking):
    before = {robot: page.joints(robot) for robot in ("FR", "GR")}
    assert {robot: len(joints) for robot, joints in before.items()} == {"FR": 6, "GR": 9}
    first = page.screenshot().astype(int)
    for robot, joints in before.items():
        page.until(lambda robot=robot, joints=joints: page.joints(robot) != joints, f"{robot} moves")
    page.until(lambda: "follower" in page.text and "leader" in page.text, "the holders of the leases")
    for _ in range(3):
        assert abs(_tool_off_centre(page)) <= 0.05
    seen = page.screenshot().astype(int)
    x, y, width, height = (int(value) for value in page.scene())
    changed = np.abs(seen - first).max(axis=2)[y : y + height, x : x + width] > 30
    assert changed.sum() > 200  # the robots in the 3-D view moved, too
    page.tab.keep("viewer-tracking.png")

    page.press("STOP")
    page.until(lambda: "an operator can reset it" in page.text, "the stop on the page")
    with connect(address, name="observer", role="observer") as cell:
        cell.subscribe(every=1, robots=["FR"])
        places = []
        for state in cell.states():
            assert all(entry.stops and entry.holder is None for entry in state.entries)
            places.append([q for entry in state.entries for q in entry.q])
            if len(places) > 5 and np.ptp(np.array(places[-5:]), axis=0).max() < 1e-6:
                break  # at rest
    for child in tracking:
        assert child.wait(30) != 0  # each reports that its robot was stopped
    page.tab.keep("viewer-stopped.png")


def test_the_token_is_removed_from_the_address_bar_and_the_page_makes_no_other_connection(page):
    assert "token" in page.url
    assert "token" not in page.tab.url
    directive = page.tab.evaluate(_CONNECT_ELSEWHERE)
    assert directive == "connect-src"


def test_a_reload_has_no_effect_and_reset_ends_the_stop(page, address):
    page.press("STOP")
    page.until(lambda: "an operator can reset it" in page.text, "the stop on the page")
    page.tab.reload()
    page.until(lambda: "STOP" in page.text and len(page.joints("GR")) == 9, "the reloaded page")
    page.until(lambda: "an operator can reset it" in page.text, "the stop on the reloaded page")
    page.press("Reset")
    with connect(address, name="observer", role="observer") as cell:
        cell.subscribe(every=1)
        first = next(states := cell.states())
        state = next(s for s in states if s.time > first.time + 60.0 or not any(e.stops for e in s.entries))
        assert not any(entry.stops for entry in state.entries)
        assert all(not (entry.late_commands or 0) for entry in state.entries)
    page.until(lambda: "running" in page.text, "no stop in force")

"""A robot driven from the page by a real pointer: it moves while a handle is held, else it rests."""

import math
import signal
from time import monotonic

import numpy as np
import pytest

from armgate.client import connect
from support.pages import PATIENCE, Page

from .conftest import CONFIG, PLAIN, process


class Eye:
    """An operator who looks on."""

    def __init__(self, cell, robot="GR"):
        self.cell, self.robot = cell, robot
        cell.subscribe(every=1, robots=[robot])
        self.states = cell.states()

    def entry(self, where=lambda entry: True):
        end = monotonic() + PATIENCE
        for state in self.states:
            entry = next(entry for entry in state.entries if entry.robot == self.robot)
            if where(entry):
                return entry
            assert monotonic() < end, f"it never came to that; the last: {entry}"
        raise AssertionError("states end only by an exception")

    def moving(self):
        """Until its setpoint changes visibly; where it was."""
        start = self.entry().setpoint
        self.entry(lambda entry: np.abs(np.subtract(entry.setpoint, start)).max() > 1e-3)
        return start

    def resting(self):
        """Until its setpoint stays and needs no way to rest; where that is."""
        before = self.entry()
        while True:
            now = self.entry()
            if now.setpoint == before.setpoint == pytest.approx(now.stop_end, abs=1e-9):
                return np.array(now.setpoint)
            before = now


@pytest.fixture
def eye(address):
    with connect(address, name="eye", role="operator") as cell:
        yield Eye(cell)


@pytest.fixture(scope="module")
def page(browser, viewing):
    page = Page(browser, viewing)
    yield page
    page.tab.close()  # an open page costs a core


def take(page, robot="GR"):
    def taken():
        if f"Release {robot}" in page.text:
            return True
        page.pressed(f"Drive {robot}")  # again if the page is just being built anew
        return False

    page.until(taken, "the handles")


def give_back(page, eye, robot="GR"):
    page.press(f"Release {robot}")
    eye.entry(lambda entry: entry.holder is None)
    page.until(lambda: f"Driving {robot}" not in page.text.split("released")[-1], "no handles any more")


def drag_gizmo(page, eye):
    """Holds the gizmo and pulls until the robot moves; where it was before. The pointer stays down."""
    x, y = page.until(page.gizmo, "the gizmo")
    start = eye.resting()
    page.point(x, y)
    page.point(x, y, press=True)
    for step in range(1, 200):
        page.point(x + 4 * min(step, 20) + step % 2, y + 2 * min(step, 20))
        if np.abs(eye.entry().setpoint - start).max() > 1e-3:
            return start
    raise AssertionError("the robot does not follow the gizmo")


def test_the_gizmo_moves_the_robot_while_it_is_held(page, eye):
    take(page)
    eye.entry(lambda entry: entry.holder == "view")
    start = drag_gizmo(page, eye)
    page.tab.keep("viewer-driving.png")
    page.let_go()
    end = eye.resting()
    assert np.abs(end - start).max() > 1e-3
    counts = eye.entry().counts
    assert counts["admitted"] + counts.get("limited:acceleration", 0) > 5
    give_back(page, eye)
    assert eye.resting() == pytest.approx(end)


def test_a_slider_moves_its_joint_while_it_is_held(page, eye):
    take(page)
    start = eye.resting()
    x, y, width = page.slider("A1 [°]")
    page.point(x, y, press=True)
    for step in range(200):  # a busy browser leaves movements out
        page.point(x + 0.48 * width + step % 2, y)
        if eye.entry().setpoint[3] > start[3] + 0.02:
            break
    eye.entry(lambda entry: entry.setpoint[3] > start[3] + 0.02)
    page.let_go()
    end = eye.resting()
    assert end[3] < math.radians(170)  # it was let go before it was where the slider was
    assert np.delete(end, 3) == pytest.approx(np.delete(start, 3), abs=1e-9)
    page.until(lambda: abs(page.slider("A1 [°]")[0] - x) < 0.4 * width, "the slider back at the robot")
    give_back(page, eye)


def test_a_stop_while_dragging_ends_the_drive_and_is_reported(page, eye):
    take(page)
    drag_gizmo(page, eye)
    page.press("STOP")
    eye.entry(lambda entry: entry.stops and entry.holder is None)
    eye.resting()
    page.until(lambda: "was stopped" in page.text and "Release GR" not in page.text, "what ended it")
    page.let_go()
    page.press("Reset")
    eye.entry(lambda entry: not entry.stops)


def test_a_page_that_is_reloaded_while_dragging_leaves_the_robot_at_rest(page, eye):
    take(page)
    drag_gizmo(page, eye)
    page.tab.reload()
    eye.entry(lambda entry: entry.holder is None)
    rest = eye.resting()
    page.let_go()
    page.until(lambda: "Drive GR" in page.text and "Release GR" not in page.text, "the page again")
    assert eye.resting() == pytest.approx(rest)


def test_a_leased_robot_cannot_be_acquired_and_the_loser_of_a_takeover_is_notified(page, eye):
    with eye.cell.acquire("GR"):
        page.press("Drive GR")
        # Reading states keeps the lease alive.
        page.until(lambda: eye.entry() and "GR is held by eye" in page.text, "who holds it")
        assert "Release GR" not in page.text
    take(page)
    drag_gizmo(page, eye)
    with eye.cell.acquire("GR", takeover=True):
        page.until(lambda: "Release GR" not in page.text, "no handles any more")
        page.until(lambda: "lost" in page.text, "that it was lost")
        eye.resting()
    page.let_go()


def test_only_one_of_two_pages_drives_a_robot(page, eye):
    take(page)
    other = Page(page.browser, page.url)
    other.press("Drive GR")
    other.until(lambda: "GR is driven from another page" in other.text, "who drives it")
    assert "Release GR" not in other.text
    other.tab.close()
    eye.entry(lambda entry: entry.holder == "view")
    drag_gizmo(page, eye)
    page.let_go()
    give_back(page, eye)


def test_a_daemon_that_ends_while_dragging_is_reported_and_the_page_reconnects(browser):
    with process("serve", CONFIG, "--port", "0", says="armgate: listening on ") as (found, daemon):
        port = found.rpartition(":")[2]
        view = ("view", found, *PLAIN, "--role", "controller")
        with process(*view, says="armgate: view at ") as (url, viewer):
            with connect(found, name="eye", role="observer") as cell:
                page = Page(browser, url)
                assert "Reset" not in page.text  # a controller drives, an operator resets
                take(page)
                drag_gizmo(page, Eye(cell))
                daemon.send_signal(signal.SIGKILL)
                daemon.wait(30)
            page.until(lambda: "Release GR" not in page.text, "no handles any more")
            page.let_go()
            with process("serve", CONFIG, "--port", port, says="armgate: listening on "):
                page.until(lambda: "closed the connection" not in page.text, "the new daemon")
                take(page)
                viewer.terminate()
                assert viewer.wait(30) == 0
            page.tab.close()

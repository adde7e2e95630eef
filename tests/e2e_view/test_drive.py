"""Driving from the page with a real pointer: the robot moves while a handle is held, and rests otherwise."""

import contextlib
import math
import signal
import threading
from time import monotonic

import numpy as np
import pytest

from armgate.client import connect
from support.pages import PATIENCE, Page

from .conftest import CONFIG, PLAIN, process


class Operator:
    """Client in the operator role that observes one robot."""

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
            assert monotonic() < end, f"the condition never held; the last entry: {entry}"
        raise AssertionError("states end only by an exception")

    @contextlib.contextmanager
    def reading(self):
        """Read states in a thread, which keeps a lease alive however long the browser takes."""
        done = threading.Event()
        reader = threading.Thread(target=lambda: next(state for state in self.states if done.is_set()))
        reader.start()
        try:
            yield
        finally:
            done.set()
            reader.join()

    def moving(self):
        """Wait until the setpoint changes visibly; return where it was."""
        start = self.entry().setpoint
        self.entry(lambda entry: np.abs(np.subtract(entry.setpoint, start)).max() > 1e-3)
        return start

    def resting(self):
        """Wait until the setpoint stays and no stop distance is left; return it."""
        before = self.entry()
        while True:
            now = self.entry()
            if now.setpoint == before.setpoint == pytest.approx(now.stop_end, abs=1e-9):
                return np.array(now.setpoint)
            before = now


@pytest.fixture
def operator(address):
    with connect(address, name="observer", role="operator") as cell:
        yield Operator(cell)


@pytest.fixture(scope="module")
def page(browser, viewing):
    page = Page(browser, viewing)
    yield page
    page.tab.close()  # an open page keeps a core busy


def acquire(page, robot="GR"):
    def acquired():
        if f"Release {robot}" in page.text:
            return True
        page.pressed(f"Drive {robot}")  # again if the page is just being rebuilt
        return False

    page.until(acquired, "the handles")


def press_until_refused(page, reason, robot="GR"):
    def refused():
        page.pressed(f"Drive {robot}")  # again if the page is just being rebuilt
        return reason in page.text

    page.until(refused, reason)


def release(page, operator, robot="GR"):
    page.press(f"Release {robot}")
    operator.entry(lambda entry: entry.holder is None)
    page.until(lambda: f"Driving {robot}" not in page.text.split("released")[-1], "no handles")


def drag_gizmo(page, operator):
    """Hold the gizmo and drag it until the robot moves; return where it was. The pointer stays down."""
    x, y = page.until(page.gizmo, "the gizmo")
    start = operator.resting()
    page.point(x, y)
    page.point(x, y, press=True)
    for step in range(1, 200):
        page.point(x + 4 * min(step, 20) + step % 2, y + 2 * min(step, 20))
        if np.abs(operator.entry().setpoint - start).max() > 1e-3:
            return start
    raise AssertionError("the robot does not follow the gizmo")


@pytest.mark.slow
def test_the_gizmo_moves_the_robot_while_it_is_held(page, operator):
    acquire(page)
    operator.entry(lambda entry: entry.holder == "view")
    start = drag_gizmo(page, operator)
    page.tab.keep("viewer-driving.png")
    page.release_pointer()
    end = operator.resting()
    assert np.abs(end - start).max() > 1e-3
    counts = operator.entry().counts
    assert counts["admitted"] + counts.get("limited:acceleration", 0) > 5
    release(page, operator)
    assert operator.resting() == pytest.approx(end)


@pytest.mark.slow
def test_a_slider_moves_its_joint_while_it_is_held(page, operator):
    acquire(page)
    start = operator.resting()
    x, y, width = page.slider("A1 [°]")
    page.point(x, y, press=True)
    for step in range(200):  # a busy browser skips movements
        page.point(x + 0.48 * width + step % 2, y)
        if operator.entry().setpoint[3] > start[3] + 0.02:
            break
    operator.entry(lambda entry: entry.setpoint[3] > start[3] + 0.02)
    page.release_pointer()
    end = operator.resting()
    assert end[3] < math.radians(170)  # released before the robot reached the position of the slider
    assert np.delete(end, 3) == pytest.approx(np.delete(start, 3), abs=1e-9)
    page.until(lambda: abs(page.slider("A1 [°]")[0] - x) < 0.4 * width, "the slider at the robot's position")
    release(page, operator)


def test_a_stop_while_dragging_ends_the_drive_and_is_reported(page, operator):
    acquire(page)
    drag_gizmo(page, operator)
    page.press("STOP")
    operator.entry(lambda entry: entry.stops and entry.holder is None)
    operator.resting()
    page.until(lambda: "was stopped" in page.text and "Release GR" not in page.text, "the reason for the end")
    page.release_pointer()
    page.press("Reset")
    operator.entry(lambda entry: not entry.stops)


@pytest.mark.slow
def test_a_page_that_is_reloaded_while_dragging_leaves_the_robot_at_rest(page, operator):
    acquire(page)
    drag_gizmo(page, operator)
    page.tab.reload()
    operator.entry(lambda entry: entry.holder is None)
    rest = operator.resting()
    page.release_pointer()
    page.until(lambda: "Drive GR" in page.text and "Release GR" not in page.text, "the reloaded page")
    assert operator.resting() == pytest.approx(rest)


@pytest.mark.slow
def test_a_leased_robot_cannot_be_acquired_and_the_loser_of_a_takeover_is_notified(page, operator):
    with operator.cell.acquire("GR"), operator.reading():
        press_until_refused(page, "GR is held by observer")
        assert "Release GR" not in page.text
    acquire(page)
    drag_gizmo(page, operator)
    with operator.cell.acquire("GR", takeover=True):
        with operator.reading():
            page.until(lambda: "Release GR" not in page.text, "no handles")
            page.until(lambda: "the lease of GR ended" in page.text, "the loss of the lease")
        operator.resting()
    page.release_pointer()


@pytest.mark.slow
def test_only_one_of_two_pages_drives_a_robot(page, operator):
    acquire(page)
    other = Page(page.browser, page.url)
    press_until_refused(other, "GR is driven from another page")
    assert "Release GR" not in other.text
    other.tab.close()
    operator.entry(lambda entry: entry.holder == "view")
    drag_gizmo(page, operator)
    page.release_pointer()
    release(page, operator)


@pytest.mark.slow
def test_a_daemon_that_ends_while_dragging_is_reported_and_the_page_reconnects(browser):
    with process("serve", CONFIG, "--port", "0", prints="armgate: listening on ") as (found, daemon):
        port = found.rpartition(":")[2]
        view = ("view", found, *PLAIN, "--role", "controller")
        with process(*view, prints="armgate: view at ") as (url, viewer):
            with connect(found, name="observer", role="observer") as cell:
                page = Page(browser, url)
                assert "Reset" not in page.text.splitlines()  # a controller drives, an operator resets
                acquire(page)
                drag_gizmo(page, Operator(cell))
                daemon.send_signal(signal.SIGKILL)
                daemon.wait(30)
            page.until(lambda: "Release GR" not in page.text, "no handles")
            page.release_pointer()
            with process("serve", CONFIG, "--port", port, prints="armgate: listening on "):
                page.until(lambda: "closed the connection" not in page.text, "the new daemon")
                acquire(page)
                viewer.terminate()
                assert viewer.wait(30) == 0
            page.tab.close()

import pytest

from armgate.apps.view.frame_timer import FrameTimer


def test_late_frames_are_caught_up_and_missed_frames_left_out(clock):
    timer = FrameTimer(10.0, clock)
    assert timer.remaining() == pytest.approx(0.1)
    clock.time += 0.13  # woken late
    assert timer.remaining() == pytest.approx(0.07)
    clock.time += 0.07
    assert timer.remaining() == pytest.approx(0.1)
    clock.time += 0.25
    assert timer.remaining() == 0.0
    assert timer.remaining() == pytest.approx(0.05)
    clock.time += 100.0
    waits = [timer.remaining() for _ in range(4)]
    assert waits[:2] == [0.0, 0.0]
    assert waits[2] == pytest.approx(0.1)

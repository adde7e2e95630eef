import pytest

from armgate.apps.view.frame_timer import FrameTimer


def test_the_timer_catches_up_after_late_frames_and_skips_missed_frames(clock):
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

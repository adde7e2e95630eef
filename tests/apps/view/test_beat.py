import pytest

from armgate.apps.view.beat import Beat


def test_turns_that_begin_late_are_caught_up_and_those_that_are_missed_left_out(clock):
    beat = Beat(10.0, clock)
    assert beat.left() == pytest.approx(0.1)
    clock.time += 0.13  # woken late
    assert beat.left() == pytest.approx(0.07)
    clock.time += 0.07
    assert beat.left() == pytest.approx(0.1)
    clock.time += 0.25
    assert beat.left() == 0.0
    assert beat.left() == pytest.approx(0.05)
    clock.time += 100.0
    waits = [beat.left() for _ in range(4)]
    assert waits[:2] == [0.0, 0.0]
    assert waits[2] == pytest.approx(0.1)

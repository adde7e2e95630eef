"""Comparison of recorded and recomputed outputs: texts that another version words differently."""

from dataclasses import replace

from armgate.audit.output_differences import TOLERANCE, differences
from armgate.audit.replay import _recorded
from armgate.events import Stopped

STOPPED = Stopped(1, ("A",), "A's link plays a plan that the gate has not given it", "gate")
REWORDED = replace(STOPPED, reason="A's link plays a plan that the gate did not send")


def test_a_stop_with_its_reason_in_other_words_is_the_same_within_a_tolerance():
    assert differences([STOPPED], [REWORDED], TOLERANCE) == []
    assert len(differences([STOPPED], [REWORDED])) == 1


def test_a_stop_of_other_robots_is_never_the_same():
    assert len(differences([STOPPED], [replace(REWORDED, robots=("B",))], TOLERANCE)) == 1


def test_only_a_stop_of_other_robots_is_new_in_a_replay():
    assert _recorded(REWORDED, [STOPPED])
    assert not _recorded(replace(REWORDED, robots=("B",)), [STOPPED])

"""The adversary and its oracle find former faults of the gate if their fixes are removed."""

import numpy as np
import pytest

from armgate.gate.clearance.motion_bounds_range import MotionBoundsRange
from armgate.gate.reservations import Reservations
from armgate.gate.retreat import Retreat
from armgate.gate.robot import RobotState
from gate import scenes
from gate.adversary import SETTINGS, arena, attack
from gate.disturbances import worst_noise
from gate.rig import DEVIATING, Player, Rig


def found(scene, tries=6, **given):
    """Return the violations of the first run of ``tries`` that has any; empty if none has."""
    (setting,) = [
        s for s in SETTINGS if s.scene == scene and all(getattr(s, key) == x for key, x in given.items())
    ]
    place = arena(setting)
    for seed in range(tries):
        violations = attack(place, setting, seed, 300).violations
        if violations:
            return violations
    return []


@pytest.mark.slow
def test_resets_to_the_noisy_measurement_are_found(monkeypatch):
    monkeypatch.setattr(RobotState, "setpoint_after_reset", lambda self: self.measured)
    monkeypatch.setattr(Reservations, "prove_setpoint", lambda *given: True)
    assert any("mm" in text for text in found("boom"))


def test_resets_that_move_the_setpoint_out_of_its_limits_are_found(monkeypatch):
    monkeypatch.setattr(RobotState, "setpoint_after_reset", lambda self: self.measured)
    rig = Rig(scenes.boom(surroundings={}), start=[np.array([1.2, 0.0])], stops=0.0)
    rig.noise[0] = np.array([1e-4, 0.0])
    for _ in range(3):
        rig.reset(rig.stop("A"))
        for _ in range(12):
            rig.step(lambda rig, i: (1e-5, 1e-5))
    assert any("J0: setpoint" in text for text in rig.tally.violations)


@pytest.mark.slow
def test_motion_bounds_that_hold_only_inside_the_limits_are_found(monkeypatch):
    monkeypatch.setattr(MotionBoundsRange, "fitted", lambda self, *given: self)
    assert any("ball" in text for text in found("lever", tries=12))


@pytest.mark.parametrize("scene", ["lane", "niche"])
def test_floors_that_survive_a_fault_are_found(monkeypatch, scene):
    monkeypatch.setattr(Retreat, "forget", lambda *given: None)
    assert any("too near" in text for text in found(scene))


@pytest.mark.slow
def test_floors_that_every_command_clears_are_found(monkeypatch):
    """A controller then gets nearer by the slack each time."""
    demand = Retreat.requirements

    def clear_floors_first(self, state, states):
        self._floor.clear()
        return demand(self, state, states)

    monkeypatch.setattr(Retreat, "requirements", clear_floors_first)
    monkeypatch.setattr(Retreat, "widens", lambda *given: True)
    assert found("lane") != []


@pytest.mark.parametrize(("scene", "given"), [("duel_noisy", {}), ("duel", {"resets": 0.03})])
def test_a_reset_with_a_pending_plan_is_found(monkeypatch, scene, given):
    resting = RobotState.resting.fget

    def hasty(self):
        pending, self.pending = self.pending, None
        try:
            return resting(self)
        finally:
            self.pending = pending

    monkeypatch.setattr(RobotState, "resting", property(hasty))
    assert any("with a plan under way" in text for text in found(scene, **given))


def test_a_standing_robot_that_is_not_reset_is_found(monkeypatch):
    monkeypatch.setattr(RobotState, "resting", property(lambda self: False))
    assert any("and is not reset" in text for text in found("boom"))


def test_a_moving_robot_that_is_reset_is_found(monkeypatch):
    monkeypatch.setattr(RobotState, "resting", property(lambda self: not self.remaining))
    assert any("left to go" in text for text in found("boom_delayed"))


def test_a_link_that_does_not_play_its_plan_is_found(monkeypatch):
    monkeypatch.setattr("armgate.gate.gate.contradiction", lambda *given: None)
    assert any("not its plan" in text for text in found("duel", traffic=DEVIATING))


def test_the_worst_noise_points_toward_the_nearest_body():
    rig = Rig(scenes.boom(), start=[np.array([-0.6, 0.0])], stops=0.0)
    assert worst_noise(rig, 0)[0] == -1e-4
    rig = Rig(scenes.boom(), start=[np.array([0.6, 0.0])], stops=0.0)
    assert worst_noise(rig, 0)[0] == 1e-4


def test_a_link_that_keeps_its_setpoint_reports_it_once():
    player = Player("A", (0.0, 1.0), keeps=True)
    player.play(0.0, (0.0, 1.0))
    rig = Rig(scenes.lane(), stops=0.0)
    _, order = rig.reset(rig.stop("A"))
    player.rebase(order)
    ticks = [player.play(0.1, (0.0, 1.0)) for _ in range(2)]
    assert [(t.rebased, t.setpoint) for t in ticks] == [(True, (0.0, 1.0)), (False, (0.0, 1.0))]
    assert player.resets == 1

"""Adversaries against the gate, checked by an independent oracle; the long form is ``make adversary``."""

import random

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from armgate.events import Outcome
from gate import adversary, scenes
from gate.adversary import ATTACKS, SETTINGS, Arena, arena
from gate.oracle import Oracle
from gate.rig import HARSH, ROUGH, Rig, Tally, Traffic


@pytest.mark.daily(2)
@pytest.mark.parametrize("number", range(len(SETTINGS)))
def test_no_adversary_breaks_the_invariant(number):
    setting = SETTINGS[number]
    place = arena(setting)
    total = Tally()
    for seed in range(3):
        total.add(adversary.attack(place, setting, 1000 * seed + number, int(580 * setting.share)))
    assert total.violations == []
    assert total.accepted > 0.1


@pytest.mark.daily(2)
@pytest.mark.parametrize("name", sorted(ATTACKS))
def test_no_single_attack_breaks_the_invariant(name):
    cell = scenes.duel(gap=1.2)
    rig = Rig(cell, 7, lag=(0.0, 0.03), oracle=Oracle(cell))
    tally = rig.run(adversary.Adversary(random.Random(name), (name,)), 400)
    assert tally.violations == []


@pytest.mark.parametrize("periods", [(0.004, 0.012), (0.012, 0.004), (0.004, 0.004)])
def test_two_robots_at_full_speed_toward_each_other_stop_at_the_stop_distance(periods):
    """Check every position by hand. One robot is refused first; the other continues until its stop ends."""
    rig = Rig(scenes.head_on(periods=periods), stops=0.0)
    fastest, promised, gaps = [0.0, 0.0], None, []
    for _ in range(700):
        rig.step(lambda rig, i: (rig.cell.robots[i].period * (1.0, -1.0)[i],))
        gaps.append(float(rig.drives[1].q[0] - rig.drives[0].q[0]) - 0.1)
        for i, player in enumerate(rig.players):
            fastest[i] = max(fastest[i], abs(player.last[0]) / rig.cell.robots[i].period)
        refused = [v is not None and v.outcome is Outcome.REFUSED for v in rig.last_verdict]
        if promised is None and any(refused):
            assert refused.count(True) == 1
            first = refused.index(False)
            promised = rig.gate.view(rig.players[first].robot).stop_end[0]
    assert fastest == pytest.approx([1.0, 1.0])
    assert min(gaps) >= 0.02
    assert gaps[-1] == min(gaps) <= 0.02 + 2.5e-3
    assert (rig.players[first].setpoint[0] - promised) * (1.0, -1.0)[first] >= -1e-12
    rig.check()
    assert rig.tally.violations == []


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("answered", [True, False])
def test_if_there_is_room_for_one_robot_the_one_commanded_first_moves(first, answered):
    """There is room for 1.5 increments, not for one of each robot; plan answers may be missing."""
    step = 5e-5
    cell = scenes.head_on(0.12 + 1.5 * step)
    traffic = Traffic() if answered else Traffic(answer_lost=1.0)
    rig = Rig(cell, traffic=traffic, stops=0.0)
    one = rig.command(first, ((step, -step)[first],))
    other = rig.command(1 - first, ((-step, step)[first],))
    assert (one.outcome, one.dq[0]) == (Outcome.ADMITTED, (step, -step)[first])
    assert (other.outcome, other.beta) == (Outcome.REFUSED, 0.0)
    assert set(other.reasons[-1].pair) == {"left/L0", "right/L0"}
    for _ in range(30):
        rig.step()
    assert rig.drives[first].q[0] == pytest.approx(cell.robots[first].start[0] + one.dq[0], abs=1e-12)
    assert rig.drives[1 - first].q[0] == cell.robots[1 - first].start[0]
    assert rig.tally.violations == []


@pytest.mark.slow
def test_two_arms_at_full_speed_toward_each_other_on_clocks_of_their_own():
    """Both move and come near each other, and neither comes too near."""
    cell = scenes.duel(gap=1.2)
    rig = Rig(cell, 1, lag=0.03, oracle=Oracle(cell), stops=0.05)

    def controller(rig, i):
        v = -rig.cell.robots[i].start * (0, 1, 1, 0) * 0.4 - rig.players[i].setpoint
        return v / max(1e-09, *(abs(v) / (rig.cell.robots[i].velocity * rig.cell.robots[i].period)))

    tally = rig.run(controller, 600)
    assert tally.violations == []
    assert tally.admitted + tally.limited > 50
    assert tally.least < 0.01


def test_the_oracle_finds_the_violations_of_a_gate_without_clearance(monkeypatch):
    """The attack is effective: without required distances the same run violates the stop distance."""
    from armgate.gate.clearance import Clearance

    original = Clearance.__init__

    def blind(self, *given):
        original(self, *given)
        self.limits_of = tuple(x - 10.0 for x in self.limits_of)

    monkeypatch.setattr(Clearance, "__init__", blind)
    setting = SETTINGS[3]
    place = Arena(scenes.wire(), Oracle(scenes.wire()))
    assert adversary.attack(place, setting, 3, 600, ("greedy", "steady")).violations != []


@pytest.mark.parametrize("violations", [[], ["A and B 19 mm, 20 needed"]])
def test_the_long_form_prints_the_violations_last_and_fails_on_any(violations, capsys):
    total = Tally(commands=4, admitted=2, limited=1, refused=1, least=1e-4, violations=violations)
    assert adversary.print_result(total, 2.0, 1) == len(violations)
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == (
        f"violations: {len(violations)}  acceptance: 0.750  "
        "smallest clearance: 0.1000 mm over the stop distance"
    )


class Machine(RuleBasedStateMachine):
    """Two robots, their stops and their messages, driven by Hypothesis."""

    place = None

    @initialize(seed=st.integers(0, 10**6), rough=st.sampled_from([ROUGH, HARSH]))
    def begin(self, seed, rough):
        if Machine.place is None:
            cell = scenes.duel(gap=1.1)
            Machine.place = Arena(cell, Oracle(cell))
        self.rig = Rig(self.place.cell, seed, (0.0, 0.03), 0.0, rough, oracle=self.place.oracle, stops=0.0)
        self.increments = [None, None]
        self.standing = []

    @rule(i=st.integers(0, 1), u=st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
    def set_increment(self, i, u):
        robot = self.rig.cell.robots[i]
        self.increments[i] = robot.velocity * robot.period * u

    @rule(i=st.integers(0, 1))
    def stop_commanding(self, i):
        self.increments[i] = None

    @rule(grids=st.integers(1, 40))
    def wait(self, grids):
        for _ in range(grids):
            self.rig.step(lambda rig, i: self.increments[i])

    @rule(i=st.integers(0, 1))
    def stop(self, i):
        self.standing.append(self.rig.stop(self.rig.cell.robots[i].name))

    @rule()
    def reset(self):
        self.standing = [s for s in self.standing if not self.rig.reset(s)[0].accepted]

    @rule()
    def check_a_stop(self):
        self.rig.check_stop()

    @invariant()
    def no_violation(self):
        if hasattr(self, "rig"):
            self.rig.check()
            assert self.rig.tally.violations == []


Machine.TestCase.settings = settings(max_examples=12, stateful_step_count=25, deadline=None)
TestMachine = Machine.TestCase

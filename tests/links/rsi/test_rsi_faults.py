"""Fault matrix of the RSI link: each fault, and the state in which link, KRC and robot end.

The tests step the link, the gate and a virtual KRC cycle by cycle. The robot moves at about a tenth
of its full speed when a fault happens.
"""

import re

import pytest

from armgate.events import LinkState
from support.rsi import Rig
from support.rsi_ends import SLOW, at_rest, gap, nothing_moves, rearm, start_anew


@pytest.fixture
def rig(tmp_path):
    return Rig(tmp_path).begin()


@pytest.fixture
def moving(rig):
    rig.drive(40, *SLOW)
    assert rig.state == "moving"
    return rig


class TestOneDatagram:
    """The KRC holds the robot for a cycle; the link continues from that position, from rest."""

    @pytest.mark.parametrize("lost", ["to_krc", "to_pc"])
    def test_lost(self, moving, lost):
        moving.drive(1, *SLOW, **{lost: False})
        moving.drive(3, *SLOW)
        assert moving.krc.status()["delay"] == 1
        assert [tick.rebased for tick in moving.ticks[-4:]].count(True) == 1
        at_rest(moving)
        assert moving.state == "ready"
        assert moving.quiet

    def test_too_late(self, moving):
        moving.drive(1, *SLOW, age=0.0045)
        moving.drive(3, *SLOW)
        assert moving.krc.status()["rejected"] == {"late": 1}
        at_rest(moving)
        assert moving.state == "ready"
        assert moving.quiet

    def test_after_a_lost_reply_the_robot_does_not_catch_up_the_lost_motion(self, moving):
        tick = moving.ticks[-1]
        moving.drive(1, *SLOW, to_krc=False)
        moving.cycle()
        held = moving.ticks[-1]
        assert held.rebased
        assert held.setpoint == tick.setpoint
        assert not any(held.increment)
        moving.drive(1, *SLOW)
        again = moving.ticks[-1]
        assert abs(again.setpoint[0] - held.setpoint[0]) <= SLOW[0]

    def test_twice(self, moving):
        moving.drive(1, *SLOW)
        count = len(moving.replies)
        assert moving.deliver(moving.telegram) is None
        assert len(moving.replies) == count
        moving.drive(10, *SLOW)
        at_rest(moving)
        assert moving.quiet
        assert moving.link.rejected["twice"] == 1
        assert moving.krc.status()["delay"] == 0

    def test_out_of_order(self, moving):
        moving.cycle(to_pc=False)
        overtaken = moving.telegram
        moving.drive(1, *SLOW)
        assert moving.deliver(overtaken) is None
        moving.drive(10, *SLOW)
        at_rest(moving)
        assert moving.quiet
        assert moving.link.rejected["old"] == 1
        assert moving.krc.status()["delay"] == 1


class TestManyDatagrams:
    @pytest.mark.parametrize("lost", ["to_krc", "to_pc"])
    def test_ten_in_a_row_fault_the_link_and_only_an_operator_arms_it_again(self, moving, lost):
        moving.cycles(10, **{lost: False})
        moving.cycle()
        assert moving.state == "faulted"
        assert moving.krc_state == "running"
        assert [change.state for change in moving.changes[1:]] == [LinkState.FAULTED]
        assert len(moving.stops) == 1
        assert "late cycles in a row" in moving.stops[0].reason
        nothing_moves(moving)
        assert gap(moving) < 1e-7
        rearm(moving)

    @pytest.mark.parametrize("lost", ["to_krc", "to_pc"])
    def test_an_unplugged_cable_loses_or_faults_the_link_and_no_stale_plan_is_played(self, tmp_path, lost):
        rig = Rig(tmp_path, timeout=100).begin()
        rig.drive(40, *SLOW)
        held = None
        for _ in range(60):
            rig.cycle(**{lost: False})
            held = rig.krc_setpoint
        rig.cycles(20)
        assert rig.state == ("lost" if lost == "to_pc" else "faulted")
        assert rig.krc_state == "running"
        assert rig.krc_setpoint == held
        nothing_moves(rig)
        rearm(rig)

    def test_beyond_timeout_the_krc_breaks_off_and_has_to_start_anew(self, tmp_path):
        rig = Rig(tmp_path, timeout=10, late_in_a_row=50).begin()
        rig.drive(40, *SLOW)
        rig.cycles(12, to_krc=False)
        assert rig.krc_state == "broken_off"
        rig.cycles(40)
        assert rig.state == "faulted"
        assert "Timeout" in rig.stops[0].reason
        rig.operate("reset")
        rig.operate("start")
        rig.cycles(20)
        assert rig.krc_state == "running"
        assert rig.state == "faulted"
        rearm(rig)


class TestTheNumbers:
    def test_an_ipoc_may_wrap(self, tmp_path):
        for bits, profile in ((32, "krc2-rsi2"), (64, "krc4-rsi3")):
            rig = Rig(tmp_path, profile, ipoc=2**bits - 50 * (4 if bits == 64 else 1)).begin()
            rig.drive(60, *SLOW)
            at_rest(rig, 100)
            assert rig.quiet
            assert rig.state == "ready"
            assert rig.krc.status()["delay"] == 0
            assert rig.krc.status()["ipoc"] < 10000

    def test_an_ipoc_that_jumps_faults_the_link(self, moving):
        at_rest(moving)
        moving.krc.jump_ipoc(5_000_000_001)
        moving.cycles(3)
        assert moving.state == "faulted"
        assert "IPOC jumped" in moving.stops[0].reason
        assert moving.krc_state == "running"  # it is answered, and held
        nothing_moves(moving)
        rearm(moving)

    def test_after_a_jump_while_moving_the_held_position_is_unknown_so_the_krc_has_to_start_anew(
        self, moving
    ):
        moving.krc.jump_ipoc(5_000_000_001)
        moving.cycles(200)
        assert moving.state == "faulted"
        assert moving.krc_state == "broken_off"
        start_anew(moving)


class TestTheKrc:
    def test_restarts_while_moving(self, moving):
        moving.operate("restart")
        moving.cycles(30)
        assert moving.state == "lost"
        assert "anew" in moving.stops[0].reason
        assert moving.krc_state == "running"
        nothing_moves(moving)
        rearm(moving)

    def test_is_stopped_by_its_button_and_moved_by_hand_meanwhile(self, moving):
        moving.operate("estop")
        moving.cycles(200)
        assert moving.state == "lost"
        assert "no telegram" in moving.stops[0].reason
        assert not moving.reset()  # the gate does not know that the robot is at rest
        moving.operate("reset")
        assert moving.krc.jog("A1", -20.0) is None
        moving.operate("start")
        nothing_moves(moving)
        rearm(moving)

    def test_pauses_at_rest_and_goes_on(self, moving):
        at_rest(moving)
        moving.operate("pause")
        moving.cycles(200)
        assert moving.state == "lost"
        moving.operate("resume")
        moving.cycles(20)
        assert moving.krc_state == "running"
        rearm(moving)

    @pytest.mark.daily(1)
    @pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3"])
    @pytest.mark.parametrize("silent", [5, 200])
    @pytest.mark.parametrize("jog", [0.0, -2.0, None], ids=["stays", "jogged", "led-back"])
    @pytest.mark.parametrize("first", ["estop", "stop"])
    def test_begins_anew_from_the_same_port_and_no_stale_correction_is_commanded(
        self, tmp_path, profile, silent, jog, first
    ):
        rig = Rig(tmp_path, profile).begin()
        rig.drive(60, SLOW[0], 0.0, 0.0, 0.0, 0.0, 0.0)
        at_rest(rig)
        source = rig.source
        rig.operate(first)
        rig.cycles(silent)
        if first == "estop":
            rig.operate("reset")
        assert rig.krc.jog("A1", -rig.krc.status()["setpoint"]["A1"] if jog is None else jog) is None
        rig.operate("start")
        rig.source = source
        begun = rig.krc_setpoint
        rig.cycles(50)
        assert rig.krc_state == "running"
        assert rig.krc_setpoint == begun
        nothing_moves(rig)
        rearm(rig)

    @pytest.mark.daily(1)
    @pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3"])
    def test_restarts_at_rest_on_the_same_port(self, tmp_path, profile):
        rig = Rig(tmp_path, profile).begin()
        rig.drive(60, *SLOW)
        at_rest(rig)
        source, held = rig.source, rig.krc_setpoint
        rig.operate("restart")
        rig.source = source
        rig.cycles(30)
        assert (rig.krc_state, rig.state) == ("running", "lost")
        assert rig.krc_setpoint == pytest.approx(held, abs=1e-6)  # at its present position
        rearm(rig)

    def test_is_at_another_position_after_a_pause_so_it_has_to_start_anew(self, moving):
        at_rest(moving)
        moving.operate("pause")
        moving.cycles(200)
        moving.operate("resume")
        moving.cycles(110, edit=lambda data: re.sub(rb'(<AIPos A1=")[^"]*', rb"\g<1>1.0", data))
        assert moving.krc_state == "broken_off"  # it was not answered
        assert not moving.reset() or moving.state != "ready"
        start_anew(moving)

    @pytest.mark.daily(1)
    @pytest.mark.parametrize("profile", ["krc2-rsi2", "krc4-rsi3"])
    def test_pauses_while_moving_so_it_has_to_start_anew(self, tmp_path, profile):
        rig = Rig(tmp_path, profile).begin()
        rig.drive(40, *SLOW)
        rig.operate("pause")
        rig.cycles(200)
        rig.operate("resume")
        rig.cycles(200)
        assert rig.krc_state == "broken_off"
        assert rig.state == "lost"
        start_anew(rig)

    def test_a_measured_position_that_jumps_faults_the_link(self, moving):
        def edit(data):
            return re.sub(rb'(<AIPos A1=")[^"]*', rb"\g<1>99.0", data)

        at_rest(moving)
        moving.cycle(edit=edit)
        assert moving.state == "faulted"
        assert "A1 jumped" in moving.stops[0].reason
        rearm(moving)

    def test_jumps_while_moving_and_is_brought_to_rest_without_a_step(self, moving):
        moving.cycle(edit=lambda data: re.sub(rb'(<AIPos A1=")[^"]*', rb"\g<1>99.0", data))
        assert moving.state == "faulted"
        assert moving.link.remaining > 0
        at_rest(moving)
        assert moving.krc_state == "running"

"""Invalid data from a KRC or another sender, and the documented reaction of the RSI link."""

import re

import pytest

from armgate.emulator.krc.context import Limits
from support.krcs import krc_file, sen
from support.rsi import KRC, SEND, SIX, Rig
from support.rsi_ends import SLOW, at_rest, rearm, start_anew


@pytest.fixture
def moving(tmp_path):
    rig = Rig(tmp_path).begin()
    rig.drive(40, *SLOW)
    return rig


class TestConfigurations:
    """With each mismatch the link becomes faulted, the robot does not move, and a note names the remedy."""

    def ends(self, rig, cycles=110):
        rig.operate("start")
        start = rig.krc_setpoint
        rig.cycles(cycles)
        assert rig.krc_setpoint == start
        assert rig.state == "faulted"
        return " ".join([*rig.notes, rig.changes[-1].reason])

    @pytest.mark.parametrize("how", [{"sentype": "Other"}])
    def test_sentype(self, tmp_path, how):
        rig = Rig(tmp_path, peer_file=krc_file(SEND, SIX, **how))
        assert "SENTYPE" in self.ends(rig)
        assert rig.krc_state in ("waiting", "broken_off")

    def test_tags(self, tmp_path):
        peer = krc_file(SEND, tuple(tag.replace("AK", "Other") for tag in SIX))
        rig = Rig(tmp_path, peer_file=peer)
        assert "A1 is not measured to follow" in self.ends(rig)
        assert rig.krc_state == "running"  # it is answered by zeros

    def test_an_axiscorr_that_cuts_silently(self, tmp_path):
        rig = Rig(tmp_path, limits=Limits(1.0)).begin()
        rig.drive(60, *SLOW)
        rig.cycles(360)
        assert rig.state == "faulted"
        assert "AXISCORR" in rig.changes[-1].reason

    def test_axiscorrmon_that_stops(self, tmp_path):
        rig = Rig(tmp_path, monitor=Limits(2.0)).begin()
        rig.drive(60, *SLOW)
        rig.cycles(60)
        assert rig.krc_state == "broken_off"
        assert rig.state == "lost"
        start_anew(rig)

    def test_a_krc_whose_timeout_is_shorter_than_the_cells(self, tmp_path):
        rig = Rig(tmp_path, krc_timeout=3, late_in_a_row=50).begin()
        rig.drive(40, *SLOW)
        rig.cycles(4, to_krc=False)
        rig.cycles(60)
        assert rig.krc_state == "broken_off"
        assert rig.state == "lost"
        start_anew(rig)

    def test_another_krcs_address(self, tmp_path):
        rig = Rig(tmp_path, krc="192.168.1.21")
        rig.operate("start")
        rig.cycles(110)
        assert (rig.state, rig.krc_state) == ("waiting", "broken_off")
        assert [note.startswith(f"R: a datagram from {KRC}:") for note in rig.notes] == [True]

    def test_a_telegram_without_a_needed_value(self, tmp_path):
        rig = Rig(tmp_path, peer_file=krc_file(("DEF_AIPos", "DEF_Delay"), SIX))
        assert "ASPos A1 is missing" in self.ends(rig)
        assert rig.krc_state == "broken_off"  # it was never answered

    @pytest.mark.parametrize(("cell", "krc", "cycles"), [(0.012, 0.004, 1200), (0.004, 0.012, 400)])
    def test_the_wrong_cycle(self, tmp_path, cell, krc, cycles):
        rig = Rig(tmp_path, cycle=cell)
        rig.period = krc
        assert f"every {1000 * krc:.1f} ms" in self.ends(rig, cycles)

    def test_millimetres_times_180_by_pi(self, tmp_path):
        rig = Rig(tmp_path, "krc2-rsi2", gantry=True)
        rig.operate("start")
        rig.cycles(30)
        assert any("set axes.E1.received to 57.29" in note for note in rig.notes)

    def test_one_decimal(self, tmp_path):
        rig = Rig(tmp_path, precision=1)
        rig.operate("start")
        rig.cycles(50)
        assert sum("Precision" in note for note in rig.notes) == 1

    def test_a_robot_that_is_not_at_the_position_of_its_program(self, tmp_path):
        rig = Rig(tmp_path)
        rig.operate("start")
        rig.cycles(50, edit=lambda data: re.sub(rb'(<AIPos A1=")[^"]*', rb"\g<1>7.0", data))
        assert rig.state == "faulted"
        assert "A1 is at 7.00 deg" in rig.changes[-1].reason
        assert not rig.replies


class TestBadInput:
    """Bad input is rejected, counted and logged once; the robot moves on unaffected."""

    @pytest.mark.daily(1)
    @pytest.mark.parametrize(
        ("data", "kind"),
        [
            (b"x" * 65507, "xml"),
            (b"<Rob><IPOC>1</IPOC>", "xml"),
            (b'<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]><Rob><IPOC>&c;</IPOC></Rob>', "xml"),
            (b"<Rob>" + b"<a>" * 600 + b"</a>" * 600 + b"</Rob>", "xml"),
            (b'<?xml version="1.0" encoding="utf-16"?><Rob/>', "ipoc"),
            (b"\xff\xfe\x00", "xml"),
            (b"", "xml"),
            (b"<Sen><IPOC>5</IPOC></Sen>", "root"),
            (b"<Rob><IPOC>-5</IPOC></Rob>", "ipoc"),
            (b"<Rob><IPOC>99</IPOC></Rob>", "short"),
        ],
        ids=lambda value: value if isinstance(value, str) else "",
    )
    def test_junk(self, moving, data, kind):
        for _ in range(5):
            moving.drive(1, *SLOW)
            assert moving.deliver(data) is None
        at_rest(moving)
        assert moving.quiet
        assert moving.link.rejected[kind] == 5
        assert len(moving.notes) == (kind != "short")

    @pytest.mark.parametrize("source", [("10.0.0.9", 40001), (KRC, 50000)])
    def test_other_senders(self, moving, source):
        moving.drive(1, *SLOW)
        for _ in range(5):
            assert moving.deliver(moving.telegram, source=source) is None
            moving.drive(1, *SLOW)
        at_rest(moving)
        assert moving.quiet
        assert moving.link.rejected["sender"] == 5
        assert len(moving.notes) == 1

    @pytest.mark.daily(1)
    @pytest.mark.parametrize("text", [b"nan", b"1e999", b"", b"1,5", b"0x10"])
    def test_a_value_that_is_no_number_contradicts_the_configuration(self, moving, text):
        at_rest(moving)
        moving.cycle(edit=lambda data: re.sub(rb'(<AIPos A1=")[^"]*', rb"\g<1>" + text, data))
        assert moving.state == "faulted"
        rearm(moving)


class TestTheForm:
    def test_the_first_reply_is_all_zeros_and_echoes_the_ipoc(self, tmp_path):
        rig = Rig(tmp_path, ipoc=0)
        rig.operate("start")
        rig.cycle()
        assert rig.replies == [sen(0)]

    def test_rsi_2_begins_with_a_short_frame_that_is_not_answered(self, tmp_path):
        rig = Rig(tmp_path, "krc2-rsi2")
        rig.operate("start")
        rig.cycle()
        assert not rig.replies
        assert rig.link.rejected["short"] == 1
        rig.until_ready()

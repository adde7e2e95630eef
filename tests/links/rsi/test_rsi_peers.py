"""Peculiarities of public simulators, drivers' files and old controllers, and the link's response."""

import re

import pytest

from armgate.links.rsi.axes import axes_of
from armgate.links.rsi.telegram import TelegramError, TelegramReader
from support.krcs import ControllerRig, krc_file, sen
from support.rsi import SIX, Rig
from support.rsi_ends import SLOW, at_rest, gap, nothing_moves, rearm

AXES = axes_of([(f"A{number}", False) for number in range(1, 7)], {})
P = 'A1="0.0" A2="-90.0" A3="90.0" A4="0.0" A5="90.0" A6="0.0"'
POSITIONS = f"<AIPos {P}/><ASPos {P}/>"


def with_delay(data, delay):
    return re.sub(rb'<Delay D="\d+"/>', b'<Delay D="%d"/>' % delay, data)


class TestTheSameIpocAgain:
    """A simulator that repeats its telegram, with a larger Delay, until it is answered."""

    def lost(self, rig, times=1):
        """Lose the reply to a telegram; deliver the telegram again."""
        rig.drive(1, *SLOW, to_krc=False)
        lost = rig.replies[-1]
        delay = rig.krc.status()["delay"]
        for number in range(1, times + 1):
            rig.time += rig.period
            again = rig.deliver(with_delay(rig.telegram, delay + number))
            assert again == lost
            rig.waiting = rig.waiting[-1:]

    def goes_on(self, rig):
        """Continue the KRC's telegrams, each with the Delay of the lost cycles."""
        rig.drive(40, *SLOW, edit=lambda data: with_delay(data, 1))
        rig.cycles(120, edit=lambda data: with_delay(data, 1))

    def test_the_same_reply_is_sent_again_and_the_run_continues(self, tmp_path):
        rig = Rig(tmp_path).begin()
        rig.drive(20, *SLOW)
        self.lost(rig)
        self.goes_on(rig)
        assert rig.state == "ready"
        assert rig.quiet
        assert gap(rig) < 1e-7
        assert sum("again" in note for note in rig.notes) == 1

    def test_the_robot_starts_from_rest_after_it_was_held(self, tmp_path):
        rig = Rig(tmp_path).begin()
        rig.drive(20, *SLOW)
        self.lost(rig)
        rig.cycle(edit=lambda data: with_delay(data, 1))
        assert rig.ticks[-1].rebased
        assert not any(rig.ticks[-1].increment)

    def test_a_repeated_telegram_with_the_same_delay_is_rejected_as_a_duplicate(self, tmp_path):
        rig = Rig(tmp_path).begin()
        rig.drive(5, *SLOW)
        assert rig.deliver(rig.telegram) is None
        assert rig.link.rejected["twice"] == 1

    def test_too_many_in_a_row_fault_the_link_with_the_reason(self, tmp_path):
        rig = Rig(tmp_path).begin()
        rig.drive(20, *SLOW)
        self.lost(rig, times=8)
        assert rig.state == "faulted"
        assert "late cycles in a row" in rig.stops[0].reason

    def test_while_synchronising(self, tmp_path):
        rig = Rig(tmp_path)
        rig.operate("start")
        rig.cycles(20)
        rig.cycle(to_krc=False)
        lost = rig.replies[-1]
        assert rig.deliver(with_delay(rig.telegram, 1)) == lost
        for _ in range(600):
            rig.cycle(edit=lambda data: with_delay(data, 1))
            if rig.state == "ready":
                break
        assert rig.state == "ready"


class TestAGap:
    """The KRC sends nothing for a while, like a process that is stopped and continued."""

    @pytest.mark.daily(1)
    @pytest.mark.parametrize("cycles", [10, 25, 80])
    def test_a_moving_robot_stops_with_a_reason_and_a_new_run_works(self, tmp_path, cycles):
        rig = Rig(tmp_path, cycle=0.012).begin()
        rig.drive(40, *SLOW)
        for _ in range(cycles):
            rig.time += rig.period
            rig.poll()
        assert rig.state == "lost"
        assert "no telegram for 0.1 s" in rig.stops[0].reason
        rig.cycles(60)
        assert any("the KRC holds" in note for note in rig.notes)
        nothing_moves(rig, 20)
        rig.operate("stop")
        rig.operate("start")
        rig.cycles(5)
        rearm(rig)

    def test_a_reset_before_the_new_run_reports_the_reason_too(self, tmp_path):
        rig = Rig(tmp_path, cycle=0.012).begin()
        rig.drive(40, *SLOW)
        rig.time += 0.3
        rig.poll()
        rig.cycles(40)
        assert rig.reset()
        rig.cycles(40)
        assert rig.state == "faulted"
        assert "the KRC holds" in rig.changes[-1].reason
        rig.operate("stop")
        rig.operate("start")
        rig.cycles(5)
        rearm(rig)

    def test_a_reset_right_before_the_new_run_counts_for_it(self, tmp_path):
        rig = Rig(tmp_path, cycle=0.012).begin()
        rig.drive(40, *SLOW)
        at_rest(rig)
        rig.operate("stop")
        rig.cycles(20)
        rig.operate("start")
        rig.cycles(5)
        assert rig.reset()
        rig.cycles(5)
        rig.operate("restart")
        rig.until_ready()


class TestWithoutAspos:
    FILE = krc_file(("DEF_RIst", "DEF_AIPos", "DEF_Delay"), SIX)

    def rig(self, folder, **how):
        return Rig(folder, file=self.FILE, reference="measured", **how)

    @pytest.mark.parametrize("precision", [4, 6])
    def test_it_works_with_the_measured_position_as_the_reference(self, tmp_path, precision):
        rig = self.rig(tmp_path, precision=precision).begin()
        rig.drive(40, *SLOW)
        rig.cycles(200)
        assert rig.quiet
        assert rig.state == "ready"
        assert gap(rig) < 2e-6

    def test_the_reference_is_taken_when_the_robot_rests(self, tmp_path):
        rig = self.rig(tmp_path)
        rig.operate("start")
        before, far = rig.krc_setpoint, iter(range(30, 0, -1))

        def moving(data):
            shift = 0.05 * next(far, 0)
            return re.sub(
                rb'(<AIPos A1=")([^"]*)', lambda m: m[1] + b"%.6f" % (float(m[2]) + shift), data
            )  # fmt: skip

        rig.cycles(40, edit=moving)
        assert rig.krc_setpoint == before
        rig.until_ready()
        assert rig.ticks[-1].setpoint == pytest.approx(before, abs=2e-8)

    @pytest.mark.parametrize("cell", ["absolute", "relative"])
    def test_the_mode_is_proven_too(self, tmp_path, cell):
        other = {"absolute": "relative", "relative": "absolute"}[cell]
        text = krc_file(("DEF_AIPos", "DEF_Delay"), SIX, hold=int(cell == "absolute"))
        rig = Rig(tmp_path, file=text, reference="measured", mode=cell, krc_mode=other)
        rig.operate("start")
        rig.synchronise()
        assert f"RSI_ON(#{other.upper()})" in rig.changes[-1].reason

    def test_a_doubtful_new_run_on_the_same_port_is_not_answered(self, tmp_path):
        rig = self.rig(tmp_path).begin()
        rig.drive(60, *SLOW)
        at_rest(rig)
        source = rig.source
        rig.operate("stop")
        rig.cycles(60)
        rig.operate("start")
        rig.source, begun = source, rig.krc_setpoint
        rig.cycles(60)
        assert rig.krc_setpoint == begun
        assert any("the KRC holds" in note for note in rig.notes)
        rig.cycles(60)
        assert rig.krc_state == "broken_off"
        rig.operate("reset")
        rig.operate("start")
        rig.source = source
        rig.cycles(10)
        rearm(rig)

    def test_without_the_option_the_refusal_names_it(self, tmp_path):
        with pytest.raises(Exception, match=r"SEND lacks DEF_ASPos; .*link\.reference: measured"):
            Rig(tmp_path, file=self.FILE)


class TestDecimals:
    @staticmethod
    def printed(data):
        """Return the telegram with numbers as many languages print them: at most one zero at the end."""
        return re.sub(
            rb'(?<==")-?\d+\.\d+', lambda m: repr(round(float(m[0]), 6)).encode(), data
        )  # fmt: skip

    def test_values_that_are_exact_in_one_decimal_cause_no_note(self, tmp_path):
        rig = Rig(tmp_path)
        rig.operate("start")
        rig.synchronise(edit=self.printed)
        rig.cycles(50, edit=self.printed)
        assert rig.state == "ready"
        assert rig.notes == []

    def test_a_krc_with_one_decimal_is_named_and_refused(self, tmp_path):
        rig = Rig(tmp_path, precision=1)
        rig.operate("start")
        rig.synchronise()
        assert rig.state == "faulted"
        assert sum("sends 1 decimal(s)" in note for note in rig.notes) == 1


class TestTelegrams:
    @pytest.mark.parametrize(
        ("inner", "kind", "expected"),
        [
            (f"<Dat TaskType='b'>{POSITIONS}<IPOC>1</IPOC></Dat>", "form", "<Dat>, the form of ERX"),
            (f"{POSITIONS}<GPIO 01='0'/><Delay D='0'/><IPOC>1</IPOC>", "xml", "not well-formed"),
            (f"{POSITIONS}<Delay D='0.5'/><IPOC>1</IPOC>", "element", "Delay D is '0.5'"),
        ],
    )
    def test_a_mismatch_is_named(self, inner, kind, expected):
        with pytest.raises(TelegramError, match=re.escape(expected)) as caught:
            TelegramReader(AXES).read(f"<Rob>{inner}</Rob>".encode())
        assert caught.value.kind == kind

    @pytest.mark.parametrize("delay", ["0", "0.0", "0.0000", "12.0"])
    def test_a_delay_that_is_printed_as_a_double(self, delay):
        data = f'<Rob>{POSITIONS}<Delay D="{delay}"/><IPOC>7</IPOC></Rob>'.encode()
        reader = TelegramReader(AXES)
        assert [reader.read(data).delay for _ in range(3)] == [int(float(delay))] * 3

    @pytest.mark.parametrize("encoding", ["latin-1", "cp1252"])
    def test_text_in_another_encoding_is_named(self, encoding):
        data = f'<Rob>{POSITIONS}<Delay D="0"/><Msg>Störung</Msg><IPOC>1</IPOC></Rob>'.encode(encoding)
        with pytest.raises(TelegramError, match=r"not UTF-8: byte \d+ is 0xf6, as in Latin-1"):
            TelegramReader(AXES).read(data)

    @pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-8", "utf-8-sig"])
    @pytest.mark.parametrize("entity", ['"0.0"', 'SYSTEM "file:///etc/passwd"'])
    def test_a_document_type_is_refused_in_every_encoding(self, encoding, entity):
        text = f"<!DOCTYPE Rob [<!ENTITY a {entity}>]><Rob>{POSITIONS}<Delay D='0'/><IPOC>1</IPOC></Rob>"
        for data in (text, text.replace('A1="0.0"', 'A1="&a;"')):
            with pytest.raises(TelegramError) as caught:
                TelegramReader(AXES).read(data.encode(encoding))
            assert caught.value.kind == "xml"

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
    def test_utf_8_is_read_whatever_is_declared(self, encoding):
        for declared in ("UTF-8", "ISO-8859-1", "utf-16"):
            text = f'<?xml version="1.0" encoding="{declared}"?><Rob>{POSITIONS}<Delay D="0"/><Msg>ö</Msg>'
            assert TelegramReader(AXES).read(f"{text}<IPOC>3</IPOC></Rob>".encode(encoding)).ipoc == 3


class TestCartesianCorrections:
    def test_the_virtual_krc_warns_once_that_nothing_moves(self):
        krc = ControllerRig(received=(*SIX, "RKorr.X", "RKorr.Z"))
        begun = krc.setpoint
        for _ in range(5):
            krc.get(sen(krc_ipoc(krc), more='<RKorr X="1.5" Z="0.0"/>'))
        assert krc.setpoint == begun
        (text,) = krc.log.texts("cartesian")
        assert "RKorr.X" in text
        assert "RKorr.Z" not in text

    def test_zeros_are_no_warning(self):
        krc = ControllerRig(received=(*SIX, "RKorr.X"))
        krc.get(sen(krc_ipoc(krc), more='<RKorr X="0.0"/>'))
        assert not krc.log.texts("cartesian")


def krc_ipoc(krc):
    return re.search(rb"<IPOC>(\d+)</IPOC></Rob>$", krc.telegram)[1].decode()

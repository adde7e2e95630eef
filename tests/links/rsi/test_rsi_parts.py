"""Parts of the RSI link: telegrams, IPOC and Delay, states, the KRC's file, the cell's configuration."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError
from armgate.emulator.krc import read_ethernet as krc_reads
from armgate.links.rsi.axes import axes_of
from armgate.links.rsi.ethernet_file import EthernetError, read_ethernet
from armgate.links.rsi.ipoc_and_delay import Order, TelegramCounter
from armgate.links.rsi.setup import setup_of
from armgate.links.rsi.states import TABLE, State
from armgate.links.rsi.telegram import LIMIT, ReplyWriter, TelegramError, TelegramReader
from support.krcs import FILES, krc_file, sen
from support.rsi import NINE, SEND, SIX, cell_text

AXES = axes_of([(f"joint_{number}", False) for number in range(1, 7)], {})
numbers = st.decimals(-400, 400, places=4, allow_nan=False).map(str)


def rob(values, delay="0", ipoc="7", root='Type="KUKA"', more=""):
    axes = " ".join(f'A{number}="{value}"' for number, value in enumerate(values, start=1))
    numbers = f'<Delay D="{delay}"/><IPOC>{ipoc}</IPOC>'
    return f"<Rob {root}>{more}<AIPos {axes}/><ASPos {axes}/>{numbers}</Rob>".encode()


class TestTelegrams:
    @given(st.lists(st.tuples(*[numbers] * 6), min_size=2, max_size=4), st.integers(0, 10**19))
    def test_a_telegram_is_read_alike_by_the_learnt_pattern_and_as_xml(self, rows, ipoc):
        known = TelegramReader(AXES)
        for number, row in enumerate(rows):
            data = rob(row, number, ipoc + number)
            assert known.read(data) == TelegramReader(AXES).read(data)

    @pytest.mark.parametrize("delay", ["-0", "+0", "-5", "9" * 11, "0" * 30, "0.5", "1e3"])
    def test_a_delay_is_checked_alike_by_the_learnt_pattern_and_in_xml(self, delay):
        known, whole = TelegramReader(AXES), rob(["1.5"] * 6)
        known.read(whole)
        data = re.sub(rb'<Delay D="[^"]*"', b'<Delay D="' + delay.encode() + b'"', whole)
        assert data != whole
        for reader in (known, TelegramReader(AXES)):
            with pytest.raises(TelegramError, match="Delay D is"):
                reader.read(data)

    def test_an_inner_element_with_the_name_of_the_root_is_learnt_too(self):
        known = TelegramReader(AXES)
        for ipoc in (7, 8):
            data = rob(["1.5"] * 6, 3, ipoc, root='Seq="1"', more='<Rob Seq="2"/>')
            assert known.read(data).ipoc == ipoc

    @given(st.binary(max_size=60), st.integers(0, 300), st.integers(0, 20))
    def test_a_changed_telegram_is_read_as_xml_or_rejected(self, piece, at, length):
        known = TelegramReader(AXES)
        whole = rob(["1.5"] * 6)
        known.read(whole)
        data = whole[:at] + piece + whole[at + length :]

        def outcome(reader):
            try:
                return reader.read(data)
            except TelegramError as error:
                return error.kind

        assert outcome(known) == outcome(TelegramReader(AXES))

    @pytest.mark.parametrize(
        "data",
        [
            rob(["1.5"] * 6, root='TYPE="KUKA"'),
            rob(["1.5"] * 6, root='version="1.0"'),
            rob(["1.5"] * 6, root=""),
            rob(["1.5"] * 6, more='<RIst X="0.0" Y="0.0"/><Msg>a="1.5"</Msg>'),
            rob(["1.5"] * 6).replace(b'"', b"'"),
            rob(["1.5"] * 6).replace(b"/>", b" />\n  "),
            b'<?xml version="1.0"?>' + rob(["1.5"] * 6, "0", " 7 "),
        ],
    )
    def test_small_differences_between_peers_do_not_matter(self, data):
        reader = TelegramReader(AXES)
        for _ in range(2):
            telegram = reader.read(data)
            assert (telegram.ipoc, telegram.delay, telegram.short) == (7, 0, False)
            assert telegram.q == pytest.approx([1.5 * 0.017453292519943295] * 6)

    @pytest.mark.parametrize(
        ("data", "kind"),
        [
            (b"<Rob>" + b" " * LIMIT + b"</Rob>", "xml"),
            (rob(["1"] * 5), "element"),
            (rob(["1"] * 6).replace(b"Delay", b"Late"), "element"),
            (rob(["1"] * 6).replace(b"ASPos", b"AIPos"), "element"),
            (rob(["1e400"] * 6), "value"),
            (rob(["1"] * 6, ipoc="1" * 21), "ipoc"),
        ],
    )
    def test_other_data_is_no_telegram(self, data, kind):
        with pytest.raises(TelegramError) as caught:
            TelegramReader(AXES).read(data)
        assert caught.value.kind == kind

    def test_replies_have_six_decimals_in_the_order_of_the_file(self):
        writer = ReplyWriter(read_ethernet(krc_file(SEND, SIX).encode()), AXES)
        assert writer.write([1 / 3, -2.0, 0.0, 0.0, 0.0, 1e-7], 12) == sen(12, [1 / 3, -2, 0, 0, 0, 0])


class TestNumbers:
    def placed(self, *ipocs, delay=0):
        run = TelegramCounter(ipocs[0], delay)
        return [run.place(ipoc, delay) for ipoc in ipocs[1:]]

    def test_steps_gaps_repetitions_and_late_arrivals(self):
        follows = self.placed(0, 4, 8, 8, 20, 16, 24)
        assert [one.order.value for one in follows] == ["next", "next", "twice", "next", "old", "next"]
        assert [one.missed for one in follows] == [0, 0, 0, 2, 0, 0]

    @pytest.mark.parametrize("bits", [32, 64])
    def test_an_ipoc_wraps(self, bits):
        follows = self.placed(2**bits - 8, 2**bits - 4, 0, 4)
        assert {one.order for one in follows} == {Order.NEXT}
        assert not any(one.missed for one in follows)

    def test_a_step_learnt_over_a_gap_is_corrected(self):
        assert [one.missed for one in self.placed(0, 8, 12, 20)] == [0, 0, 1]

    def test_ipocs_that_cannot_follow_are_a_jump(self):
        run = TelegramCounter(0, 5)
        assert run.place(4, 5).order is Order.NEXT
        run.learning = False
        for ipoc, delay in ((7, 5), (10**12 + 1, 5), (8, 4)):
            assert run.place(ipoc, delay).order is Order.JUMP


def test_only_an_operators_reset_leaves_lost_and_faulted():
    for (state, event), after in TABLE.items():
        if state in (State.LOST, State.FAULTED) and after is not state:
            assert (event.value, after.value) == ("rearmed", "synchronising")


class TestTheFile:
    @pytest.mark.parametrize("name", ["axis-correction.xml", "gantry-correction.xml"])
    def test_link_and_krc_read_the_same(self, name):
        data = (FILES / name).read_bytes()
        own, other = read_ethernet(data), krc_reads(data)
        assert (own.host, own.port, own.sentype, own.only_send) == (
            other.host, other.port, other.sentype, other.only_send
        )  # fmt: skip
        ours = [(e.tag, e.attribute, e.type, e.hold) for e in own.received]
        assert ours == [(e.tag, e.attribute, e.type, e.hold) for e in other.received]
        assert set(own.sent) == {e.tag for e in other.sent}

    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("<ROOT/>", "<IP_NUMBER> is missing"),
            ("<Rob/>", "expected <ROOT>"),
            ("<!DOCTYPE a><ROOT/>", "not allowed"),
            (krc_file().replace("49152", "port"), "expected a number"),
            (krc_file(hold="maybe"), "expected TRUE or FALSE"),
            ("<ROOT>" + " " * 70000, "expected at most"),
        ],
    )
    def test_an_invalid_file_is_rejected(self, text, expected):
        with pytest.raises(EthernetError, match=re.escape(expected)):
            read_ethernet(text.encode())


class TestTheCell:
    def refused(self, folder, **options):
        cell = build_cell(load_config([cell_text(folder, **options)]))
        with pytest.raises(ConfigError, match=r"cell.yaml:\d+: robots.R") as caught:
            setup_of(cell, cell.robots[0])
        return str(caught.value)

    @pytest.mark.parametrize(
        ("options", "expected"),
        [
            ({"file": krc_file(SEND, SIX, hold=0)}, "would command a jump back"),
            ({"file": krc_file(SEND, SIX, hold=1), "mode": "relative"}, "would be added again"),
            ({"file": krc_file(SEND, SIX, only_send="TRUE")}, "ONLYSEND"),
            ({"file": krc_file(("DEF_AIPos",), SIX)}, "SEND lacks DEF_Delay, DEF_ASPos"),
            ({"file": krc_file(SEND, SIX[:5])}, "0 DOUBLE elements for A6"),
            ({"file": krc_file(SEND, (*SIX, "AKorr.A1"))}, "2 DOUBLE elements for A1"),
            ({"file": krc_file(SEND, SIX), "gantry": True}, "for E1 (X)"),
            ({"file": krc_file(SEND, SIX, sentype="x" * 1000)}, "1024"),
            ({"file": "no xml"}, "not well-formed"),
            ({"axiscorr": "{A: 5.0}"}, "AXISCORR silently limits it to ±5 around 0.0"),
            ({"axes": "{A1: {joint: none}}"}, "there is no joint 'none'"),
            ({"axes": "{A1: {joint: A2}, A2: {joint: A2}}"}, "the same joint"),
            ({"precision": 2}, "expected q_tolerance"),
        ],
    )
    def test_a_mismatch_is_rejected_with_its_place(self, tmp_path, options, expected):
        assert expected in self.refused(tmp_path, **options)

    def test_a_gantry_in_the_units_of_a_krc2(self, tmp_path):
        own = "{E1: {joint: X, received: 57.29577951308232}, A6: {joint: A6, received: -1.0, sent: -1.0}}"
        cell = build_cell(load_config([cell_text(tmp_path, gantry=True, axes=own)]))
        axes = {axis.name: axis for axis in setup_of(cell, cell.robots[0]).axes}
        assert 5729.577951308232 * axes["E1"].read == pytest.approx(0.1)
        assert 0.1 * axes["E1"].sent == pytest.approx(100.0)
        assert 100.0 * axes["E2"].read == pytest.approx(0.1)
        assert axes["A6"].read < 0.0 and axes["A6"].sent < 0.0  # noqa: PT018
        assert [axis.joint for axis in setup_of(cell, cell.robots[0]).axes][:4] == ["X", "Y", "Z", "A1"]
        assert len(NINE) == len(axes)


def test_the_documents_draw_the_table_of_states():
    text = (FILES.parents[1] / "docs" / "rsi.md").read_text()
    drawn = set(re.findall(r"^    (\w+) --> (\w+): (\w+)$", text, re.MULTILINE))
    assert drawn == {(state.value, after.value, event.value) for (state, event), after in TABLE.items()}


@pytest.mark.parametrize(("name", "robots"), [("rsi-example", ["FR"]), ("rsi-virtual", ["FR", "GR"])])
def test_the_link_overlays_in_the_repository_fit_the_demo_cell(name, robots):
    configs = FILES.parent
    cell = build_cell(load_config([configs / "demo.yaml", configs / "links" / f"{name}.yaml"]))
    assert [setup_of(cell, cell.robot(robot)).robot for robot in robots] == robots

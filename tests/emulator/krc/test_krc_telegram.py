"""Tests of the writer of telegrams, read back by an independent parser."""

import xml.etree.ElementTree as ET

import pytest

from armgate.emulator.krc import read_ethernet
from armgate.emulator.krc.rsi.telegram import TelegramWriter
from support.krcs import element, ethernet, krc_file

ROOT = ("Type", "KUKA")


def test_elements_have_the_order_of_the_file_then_delay_then_ipoc():
    writer = TelegramWriter(ethernet(sent=("DEF_Delay", "DEF_ASPos", "DEF_RIst", "DEF_MACur")), 1, ROOT)
    tree = ET.fromstring(writer.write({}, 17))
    assert [child.tag for child in tree] == ["ASPos", "RIst", "MACur", "Delay", "IPOC"]
    assert tree.findtext("IPOC") == "17"
    assert tree.attrib == {"Type": "KUKA"}


@pytest.mark.parametrize(("precision", "text"), [(0, "-12"), (1, "-12.3"), (4, "-12.3457")])
def test_values_are_rounded_to_the_precision(precision, text):
    writer = TelegramWriter(ethernet(), precision, ROOT)
    tree = ET.fromstring(writer.write({"AIPos": {"A1": -12.345678}, "Delay": {"D": 3.0}}, 1))
    assert tree.find("AIPos").get("A1") == text
    assert tree.find("Delay").get("D") == "3"


def test_six_axes_are_sent_for_any_robot():
    writer = TelegramWriter(ethernet(sent=("DEF_EIPos",)), 1, ROOT)
    tree = ET.fromstring(writer.write({"EIPos": {"E1": 5.0}}, 1))
    assert list(tree.find("EIPos").attrib.items()) == [
        ("E1", "5.0"),
        *((f"E{n}", "0.0") for n in range(2, 7)),
    ]


def test_elements_of_the_user_are_grouped_and_typed():
    own = (
        element("Torque.A1", 1)
        + element("On", 2, "BOOL")
        + element("Torque.A2", 3)
        + element("Name", 4, "STRING")
    )
    text = krc_file(sent=()).replace("<SEND><ELEMENTS>", "<SEND><ELEMENTS>" + own)
    telegram = TelegramWriter(read_ethernet(text.encode()), 2, ("TYPE", "KUKA")).write({}, 0)
    assert telegram == (
        b'<Rob TYPE="KUKA"><Torque A1="0.00" A2="0.00"/><On>0</On><Name></Name><IPOC>0</IPOC></Rob>'
    )


def test_the_short_frame_has_only_the_ipoc():
    short = TelegramWriter(ethernet(), 1, ROOT).short(2**64 - 1)
    assert short == b'<Rob Type="KUKA"><IPOC>18446744073709551615</IPOC></Rob>'
    assert len(short) < 100

"""Tests of the strict parser of replies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc.errors import Fault, ReplyError
from armgate.emulator.krc.rsi.reply import ReplyParser
from support.krcs import element, ethernet, sen

FILE = ethernet(
    received=("AK.A1", "AK.A2"),
    more=element("Stop", 7, "BOOL") + element("N", 8, "LONG") + element("DEF_EStr", "INTERNAL", "STRING"),
)
PARSER = ReplyParser(FILE)


def named(data):
    return {one.name: value for one, value in PARSER.parse(data).values.items()}


def refused(data):
    with pytest.raises(ReplyError) as caught:
        PARSER.parse(data)
    return caught.value.fault, str(caught.value)


def test_values_are_read_by_name_in_any_order():
    text = (
        b'<Sen Type="ImFree"><Stop>1</Stop><EStr>h&amp;i</EStr><N>-7</N><AK A2="-1.5e0" A1=" .25"/>'
        b"<IPOC>007</IPOC></Sen>\r\n"
    )
    reply = PARSER.parse(text)
    assert reply.ipoc == "007"
    assert reply.unknown == ()
    assert named(text) == {"AK.A1": 0.25, "AK.A2": -1.5, "Stop": True, "N": -7, "EStr": "h&i"}


def test_a_reply_in_the_form_of_kukas_example_is_read():
    text = (
        b'<Sen Type="ImFree" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
        b' xsi:noNamespaceSchemaLocation="ExternalData.xsd">\n <EStr/>\n'
        b' <AK A1="0.0000" A2="0.0000" />\n <IPOC>1</IPOC>\n</Sen>'
    )
    assert named(text) == {"EStr": "", "AK.A1": 0.0, "AK.A2": 0.0}


def test_missing_values_are_absent_and_unknown_ones_are_named():
    reply = PARSER.parse(sen(5, (1.0,), tag="AKorr", more="<Free>x</Free>"))
    assert reply.values == {}
    assert reply.unknown == ("AKorr.A1", "Free")


@pytest.mark.parametrize(
    ("data", "fault", "reason"),
    [
        (b"", Fault.XML, "not well-formed"),
        (b"\x00" * 40, Fault.XML, "not well-formed"),
        (b"\xff\xfe<", Fault.XML, "byte 0 is the byte order mark"),
        (sen(1) + b"\x00", Fault.XML, "not well-formed"),
        (sen(1)[:-1], Fault.XML, "not well-formed"),
        (b"<!DOCTYPE x>" + sen(1), Fault.XML, "document type"),
        (sen(1, more="<!ENTITY>"), Fault.XML, "document type"),
        (sen(1, more="<Z>" + "z" * 900 + "</Z>"), Fault.XML, "expected at most 1024"),
        (sen(1).replace(b"Sen", b"Rob"), Fault.ROOT, "<Rob>; expected <Sen>"),
        (sen(1, sentype="imfree"), Fault.SENTYPE, "Type='imfree'; the KRC's file has SENTYPE 'ImFree'"),
        (sen(1).replace(b"Type", b"TYPE"), Fault.SENTYPE, "no Type"),
        (b'<Sen Type="ImFree"/>', Fault.NO_IPOC, "0 elements <IPOC>"),
        (sen(1, more="<IPOC>1</IPOC>"), Fault.NO_IPOC, "2 elements <IPOC>"),
        (b'<Sen Type="ImFree"><IPOC>1</IPOC><AK/></Sen>', Fault.NO_IPOC, "<AK> follows <IPOC>"),
        (sen(""), Fault.NO_IPOC, "IPOC ''; expected digits only"),
        (sen(" 1"), Fault.NO_IPOC, "IPOC ' 1'"),
        (sen("-1"), Fault.NO_IPOC, "IPOC '-1'"),
        (sen("1.0"), Fault.NO_IPOC, "IPOC '1.0'"),
        (sen("1" * 21), Fault.NO_IPOC, "expected digits only"),
        (sen("١"), Fault.NO_IPOC, "expected digits only"),
        (sen(1, (1.0,), more='<AK A1="2.0"/>'), Fault.VALUE, "AK.A1 occurs twice"),
        (sen(1, more="<AK><A1>1</A1></AK>"), Fault.VALUE, "<AK> contains elements"),
        (sen(1, more="<Stop>2</Stop>"), Fault.VALUE, "Stop='2'; expected 0 or 1"),
        (sen(1, more="<N>1.5</N>"), Fault.VALUE, "N='1.5'; expected a whole number"),
    ],
)  # fmt: skip
def test_invalid_replies_are_refused_with_fault_and_reason(data, fault, reason):
    got, text = refused(data)
    assert got is fault
    assert reason in text


@pytest.mark.parametrize(
    "text", ["", "nan", "inf", "-Infinity", "1e999", "1,5", "0x1", "1_0", "--1", "1.5.2", "١"]
)
def test_invalid_numbers_are_refused(text):
    fault, reason = refused(f'<Sen Type="ImFree"><AK A1="{text}"/><IPOC>1</IPOC></Sen>'.encode())
    assert fault is Fault.VALUE
    assert "AK.A1" in reason


@given(st.binary(max_size=1100))
def test_random_bytes_are_refused(data):
    refused(data)


@given(st.text(alphabet='<>/="& \nSenTypImFrAK1IPOC0.', max_size=80))
def test_random_text_like_xml_is_refused(text):
    refused(text.encode())


def test_every_truncated_reply_is_refused():
    whole = sen(12, (1.0, 2.0))
    for end in range(len(whole)):
        refused(whole[:end])


@given(st.integers(0, 255), st.integers(0, 200))
def test_a_damaged_byte_is_refused_or_changes_one_thing(byte, place):
    whole = bytearray(sen(12, (1.0, 2.0), sentype="ImFree"))
    whole[place % len(whole)] = byte
    try:
        reply = PARSER.parse(bytes(whole))
    except ReplyError:
        return
    same = (reply.ipoc == "12") + (named(bytes(whole)) == {"AK.A1": 1.0, "AK.A2": 2.0})
    assert same >= 1


@given(st.integers(0, 2**64 - 1), st.lists(st.floats(-1e4, 1e4), min_size=2, max_size=2))
def test_values_survive_writing_and_reading(ipoc, axes):
    reply = PARSER.parse(sen(ipoc, axes))
    assert reply.ipoc == str(ipoc)
    assert list(reply.values.values()) == pytest.approx(axes, abs=1e-6)

"""Tests of the reader of RSI Ethernet files: content, and errors with the name of the element."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.emulator.krc import KrcError, read_ethernet
from armgate.emulator.krc.rsi.ethernet import A_AXES, E_AXES
from support.krcs import FILES, element, ethernet, krc_file


def test_a_file_has_the_address_of_the_pc_and_the_elements():
    file = ethernet()
    assert (file.host, file.port, file.sentype, file.only_send) == ("127.0.0.1", 49152, "ImFree", False)
    assert [one.name for one in file.sent[:7]] == [*(f"RIst.{c}" for c in "XYZABC"), "AIPos.A1"]
    assert file.sent[-1].name == "Delay.D"
    assert [one.name for one in file.received] == [f"AK.{axis}" for axis in A_AXES]
    assert all(one.hold for one in file.received)


@pytest.mark.parametrize("path", sorted(FILES.glob("*.xml")), ids=lambda path: path.name)
def test_the_supplied_files_are_read(path):
    file = read_ethernet(path.read_bytes())
    assert None not in file.corrections(A_AXES)


@pytest.mark.parametrize("tag", ["AK", "AKorr", "Whatever"])
def test_corrections_are_found_by_axis_with_any_tag(tag):
    file = ethernet(received=[f"{tag}.{axis}" for axis in (*A_AXES, "E2")])
    assert [one.tag for one in file.corrections(A_AXES)] == [tag] * 6
    assert [one and one.name for one in file.corrections(E_AXES)] == [
        None,
        f"{tag}.E2",
        None,
        None,
        None,
        None,
    ]


def test_a_cartesian_correction_corrects_no_axis():
    """Check RKorr, whose attribute A is an angle."""
    file = ethernet(received=[f"RKorr.{name}" for name in "XYZABC"])
    assert file.corrections(A_AXES) == (None,) * 6


def test_two_groups_for_one_axis_are_refused():
    with pytest.raises(KrcError, match="both AK and BK have A1"):
        ethernet(received=("AK.A1", "BK.A1")).corrections(A_AXES)


def test_a_function_generator_has_ten_parameters():
    file = ethernet(sent=("DEF_Tech.C1",), more=element("DEF_Tech.T2", "INTERNAL"))
    assert [one.name for one in file.sent] == [f"Tech.C1{number}" for number in range(1, 11)]
    assert [one.name for one in file.received[-2:]] == ["Tech.T29", "Tech.T210"]


def test_holdon_is_off_by_default():
    assert not ethernet(hold=None).received[0].hold


def test_rsi_2_files_with_units_and_protocol_are_read():
    text = krc_file(more='<ELEMENT TAG="Free" TYPE="DOUBLE" INDX="9" UNIT="5" HOLDON="1"/>')
    text = text.replace("<SENTYPE>", "<PROTOCOL>UDP</PROTOCOL><INTERFACE>VxWorks</INTERFACE><SENTYPE>")
    assert read_ethernet(b"\xef\xbb\xbf" + text.encode()).received[-1].name == "Free"


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("<ROOT>", "<ROT>", "not well-formed"),
        ("ROOT>", "RUT>", "<RUT>; expected <ROOT>"),
        ("<SENTYPE>ImFree</SENTYPE>", "", "<CONFIG><SENTYPE> is missing"),
        ("<IP_NUMBER>127.0.0.1</IP_NUMBER>", "<IP_NUMBER> </IP_NUMBER>", "<IP_NUMBER> is missing or empty"),
        ("49152", "0", "PORT '0'; expected a number from 1 to 65535"),
        ("49152", "x", "PORT 'x'"),
        ("<ONLYSEND>FALSE", "<ONLYSEND>MAYBE", "ONLYSEND 'MAYBE'; expected TRUE or FALSE"),
        ("<SENTYPE>", "<PROTOCOL>TCP</PROTOCOL><SENTYPE>", "PROTOCOL 'TCP'; expected UDP"),
        ('TAG="AK.A1"', 'TAG="AK.A1.x"', "TAG='AK.A1.x'"),
        ('TAG="AK.A1"', 'TAG="A&lt;K"', "TAG='A<K'"),
        ('TAG="AK.A1"', 'TAG="AK.A2"', "AK.A2 occurs twice"),
        ('TAG="AK.A1"', 'TAG="IPOC"', "every telegram contains IPOC"),
        ('INDX="1"', 'INDX="2"', "RECEIVE, INDX: 2 occurs twice"),
        ('INDX="1"', 'INDX="65"', "INDX='65'; expected INTERNAL or a number from 1 to 64"),
        ('INDX="1"', "", "INDX=None"),
        ('INDX="1"', 'INDX="INTERNAL"', "AK.A1 has INDX=INTERNAL; expected a name that begins with DEF_"),
        ('TYPE="DOUBLE" INDX="1"', 'TYPE="FLOAT" INDX="1"', "AK.A1: TYPE='FLOAT'"),
        ('HOLDON="1"', 'HOLDON="2"', "AK.A1: HOLDON '2'"),
        ("DEF_AIPos", "DEF_AxPos", "the KRC has no DEF_AxPos; expected one of DEF_RIst"),
        ("DEF_AIPos", "DEF_Tech.X9", "the KRC has no DEF_Tech.X9"),
        ("<RECEIVE>", "<RECEIVED>", "not well-formed"),
    ],
)  # fmt: skip
def test_errors_name_the_element_and_what_was_expected(old, new, reason):
    text = krc_file()
    assert old in text
    with pytest.raises(KrcError) as caught:
        read_ethernet(
            text.replace(old, new).encode() if "ROOT" in old else text.replace(old, new, 1).encode()
        )
    assert reason in str(caught.value)


def test_internal_values_that_a_krc_does_not_accept_are_refused():
    with pytest.raises(KrcError, match="accepts no DEF_AIPos"):
        ethernet(more=element("DEF_AIPos", "INTERNAL"))
    assert ethernet(more=element("DEF_EStr", "INTERNAL", "STRING")).received[-1].name == "EStr"


def test_an_empty_receive_needs_onlysend():
    with pytest.raises(KrcError, match="ONLYSEND TRUE"):
        ethernet(received=())
    assert ethernet(received=(), only_send="TRUE").only_send


# --- untrusted files -------------------------------------------------------------------------------------

BOMB = '<!DOCTYPE b [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    "text",
    [
        BOMB + krc_file(),
        krc_file().replace("ImFree", "&b;"),
        '<!DOCTYPE r SYSTEM "file:///etc/passwd">' + krc_file(),
    ],
)
def test_document_types_and_entities_are_refused(text):
    with pytest.raises(KrcError, match=r"document type|not well-formed"):
        read_ethernet(text.encode())


def test_another_encoding_does_not_hide_a_document_type():
    with pytest.raises(KrcError, match="byte order mark of UTF-16"):
        read_ethernet((BOMB + krc_file()).encode("utf-16"))
    declared = "<?xml version='1.0' encoding='UTF-7'?>" + "+ADwAIQ-DOCTYPE x+AD4-" + krc_file()
    with pytest.raises(KrcError):
        read_ethernet(declared.encode())


def test_a_file_that_is_too_large_is_refused_before_parsing():
    with pytest.raises(KrcError, match="expected at most 65536"):
        read_ethernet(krc_file().encode() + b" " * 65536)


def test_deep_nesting_is_refused():
    with pytest.raises(KrcError):
        read_ethernet(b"<ROOT>" * 9000)


@given(st.binary(max_size=300))
def test_random_bytes_are_refused(data):
    with pytest.raises(KrcError):
        read_ethernet(data)


@given(st.data())
def test_a_damaged_file_is_read_or_refused(data):
    text = bytearray(krc_file().encode())
    for _ in range(data.draw(st.integers(1, 3))):
        text[data.draw(st.integers(0, len(text) - 1))] = data.draw(st.integers(0, 255))
    try:
        file = read_ethernet(bytes(text))
    except KrcError:
        return
    assert file.received

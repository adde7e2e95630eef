"""One judgement of a KRC's file by link, ``armgate check`` and virtual KRC, whose readers share no code."""

import os
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError
from armgate.emulator.krc import KrcError
from armgate.emulator.krc import read_ethernet as krc_reads
from armgate.emulator.krc.setup import peer_of
from armgate.links.rsi import setup_of, warnings_of
from armgate.links.rsi.ethernet import EthernetError, read_ethernet
from support.clients import run
from support.krcs import FILES, element, krc_file
from support.rsi import SEND, SIX, Rig, cell_text

EXAMPLES = int(os.environ.get("RSI_FILES", "300"))
"""Files that are generated for both readers; RSI_FILES=100000 for a long run."""


def link_says(data):
    try:
        return read_ethernet(data), ""
    except EthernetError as error:
        return None, str(error)


def krc_says(data):
    try:
        return krc_reads(data), ""
    except KrcError as error:
        return None, str(error)


def judged(data):
    """What both say, after it was the same."""
    (ours, refused), (theirs, other) = link_says(data), krc_says(data)
    assert (ours is None) == (theirs is None), (refused, other)
    if ours is not None:
        assert (ours.host, ours.port, ours.sentype, ours.only_send) == (
            theirs.host, theirs.port, theirs.sentype, theirs.only_send
        )  # fmt: skip
        names = [e.name for e in theirs.received if not e.internal]
        assert [e.name for e in ours.received if not e.internal] == names
        assert [e.hold for e in ours.received] == [
            e.hold for e in theirs.received if not e.name.startswith("Tech") or e.name.endswith("0")
        ]
    return refused, other


def file(**how):
    return krc_file(**{"sent": SEND, "received": SIX, **how}).encode()


def with_element(section, tag, index, type_="DOUBLE", hold="1"):
    text = krc_file(SEND, SIX)
    end = "</ELEMENTS></SEND>" if section == "SEND" else "</ELEMENTS></RECEIVE>"
    return text.replace(end, element(tag, index, type_, hold) + end).encode()


NAMED = {
    "TCP": (krc_file(SEND, SIX).replace("<SENTYPE>", "<PROTOCOL>TCP</PROTOCOL><SENTYPE>").encode(), "TCP"),
    "index-twice": (with_element("RECEIVE", "Other.X", 1), "INDX"),
    "index-twice-written-otherwise": (with_element("RECEIVE", "Other.X", "01"), "INDX"),
    "index-out-of-range": (with_element("SEND", "Other.X", 65), "65"),
    "digit-attribute": (with_element("SEND", "GPIO.01", 1, "BOOL"), "GPIO.01"),
    "digit-attribute-received": (with_element("RECEIVE", "GPIO.01", 7, "BOOL"), "GPIO.01"),
    "digit-tag": (with_element("SEND", "1st.A", 1), "1st.A"),
    "two-dots": (with_element("SEND", "A.B.C", 1), "A.B.C"),
    "no-tag": (with_element("SEND", "", 1), "TAG"),
    "tech-t1-sent": (with_element("SEND", "DEF_Tech.T1", "INTERNAL"), "Tech.T1"),
    "tech-t1-received": (with_element("RECEIVE", "DEF_Tech.T1", "INTERNAL"), "Tech.T1"),
    "unknown-internal": (with_element("SEND", "DEF_Nothing", "INTERNAL"), "DEF_Nothing"),
    "internal-without-def": (with_element("SEND", "AIPos2", "INTERNAL"), "AIPos2"),
    "ipoc": (with_element("SEND", "IPOC", 3), "IPOC"),
    "type": (with_element("RECEIVE", "X.Y", 9, "FLOAT"), "FLOAT"),
    "holdon": (with_element("RECEIVE", "X.Y", 9, hold="maybe"), "maybe"),
    "twice": (with_element("RECEIVE", "AK.A1", 9), "AK.A1"),
    "twice-by-spreading": (with_element("SEND", "AIPos.A1", 9), "AIPos.A1"),
    "cp1252": (krc_file(SEND, SIX).replace("<SEND>", "<!-- R\xfcck --><SEND>").encode("cp1252"), "UTF-8"),
    "latin-1-value": (krc_file(SEND, SIX, sentype="R\xfcck").encode("latin-1"), "UTF-8"),
    "utf-16": (krc_file(SEND, SIX).encode("utf-16"), "UTF-16"),
    "utf-16-le": (krc_file(SEND, SIX).encode("utf-16-le"), "UTF-16"),
    "utf-32": (krc_file(SEND, SIX).encode("utf-32"), "UTF-16"),
    "dashes": (krc_file(SEND, SIX).replace("<SEND>", "<!-- ---- --><SEND>").encode(), "comment"),
    "comment-without-end": (krc_file(SEND, SIX).replace("<SEND>", "<!-- <SEND>").encode(), ""),
    "doctype": (b"<!DOCTYPE ROOT>" + krc_file(SEND, SIX).encode(), "DOCTYPE"),
    "doctype-utf-16": (("<!DOCTYPE ROOT>" + krc_file(SEND, SIX)).encode("utf-16"), "UTF-16"),
    "entity": (b'<!DOCTYPE ROOT [<!ENTITY a "b">]>' + krc_file(SEND, SIX).encode(), "DOCTYPE"),
    "cdata": (krc_file(SEND, SIX, sentype="<![CDATA[x]]>").encode(), "CDATA"),
    "no-received": (krc_file(SEND, ()).encode(), "RECEIVE"),
    "port": (krc_file(SEND, SIX).replace("49152", "0").encode(), "PORT"),
    "only-send-missing": (re.sub("<ONLYSEND>.*</ONLYSEND>", "", krc_file(SEND, SIX)).encode(), "ONLYSEND"),
    "no-address": (krc_file(SEND, SIX).replace("127.0.0.1", "").encode(), "IP_NUMBER"),
}


@pytest.mark.parametrize("name", NAMED)
async def test_what_is_wrong_with_a_file_is_named_by_link_check_and_krc(tmp_path, name):
    data, said = NAMED[name]
    for text in judged(data):
        assert said in text
        assert text
    (tmp_path / "own.xml").write_bytes(data)
    cell = cell_text(tmp_path)
    cell.write_text(cell.read_text().replace("krc.xml", "own.xml"))
    loaded = build_cell(load_config([cell]))
    with pytest.raises(ConfigError, match=r"cell.yaml:\d+: robots.R.link.ethernet") as caught:
        setup_of(loaded, loaded.robots[0])
    assert said in str(caught.value)


@pytest.mark.parametrize("name", ["TCP", "digit-attribute", "cp1252"])
async def test_the_commands_refuse_it_with_status_2(tmp_path, name):
    data, said = NAMED[name]
    cell = cell_text(tmp_path)
    (tmp_path / "krc.xml").write_bytes(data)
    for arguments in (
        ("check", cell),
        ("krc", "--profile", "krc4-rsi3", "--config", tmp_path / "krc.xml"),
        ("robot-server", cell, "--socket", tmp_path / "s"),
    ):
        status, _, err = await run(*arguments)
        assert status == 2
        assert said in err
        assert "Traceback" not in err


@pytest.mark.parametrize(
    "data",
    [
        file(),
        b"\xef\xbb\xbf" + file(),
        b'<?xml version="1.0" encoding="UTF-8"?>' + file(),
        b'<?xml version="1.0" encoding="ISO-8859-1"?>' + file(),
        krc_file(SEND, SIX).replace("<SEND>", "<!-- Rückmeldung - <SEND> --><SEND>").encode(),
        krc_file(SEND, SIX).replace("<SENTYPE>", "<PROTOCOL> udp </PROTOCOL><SENTYPE>").encode(),
        with_element("RECEIVE", "DEF_EStr", "INTERNAL", "STRING"),
        with_element("RECEIVE", "DEF_Tech.T2", "INTERNAL"),
        with_element("RECEIVE", "RKorr.X", 10),
        with_element("SEND", "GPIO.I01", 1, "BOOL"),
        with_element("SEND", "_a", 64, "LONG"),
    ],
)
def test_what_is_right_is_read_the_same(data):
    assert judged(data) == ("", "")


TAGS = [
    *SIX, "EK.E1", "AKorr.A1", "DEF_EStr", "DEF_Tech.C1", "DEF_Tech.T1", "DEF_Tech.T6", "DEF_Tech.T7",
    "DEF_AIPos", "DEF_ASPos", "DEF_Delay", "DEF_MACur", "GPIO.01", "GPIO.O1", "Stop", "RKorr.X", "A-B", "ä.b",
    "a.", ".b", "IPOC", "IPOC.x", "Tech.C11", "AIPos.A1", "X Y", "DEF_", "DEF_DEF_AIPos", "Delay.D", "RIst",
]  # fmt: skip
ELEMENTS = st.builds(
    element,
    st.sampled_from(TAGS),
    st.sampled_from(
        ["INTERNAL", "internal", "", "0", "1", "2", "02", "3", "7", "64", "65", "-1", "1.0", "٣"]
    ),
    st.sampled_from(["DOUBLE", "LONG", "BOOL", "STRING", "double", ""]),
    st.sampled_from([None, "0", "1", "TRUE", "false", "2", " 1"]),
)
PIECES = [
    "",
    "<!-- a -->",
    "<!-- a--b -->",
    "<!---->",
    "<!--->",
    "<!-- -",
    "<![CDATA[]]>",
    "<!DOCTYPE a>",
    "<?a b?>",
    "é",
]


@settings(max_examples=EXAMPLES, deadline=None)
@given(
    st.lists(ELEMENTS, max_size=3),
    st.lists(ELEMENTS, max_size=3),
    st.sampled_from(PIECES),
    st.sampled_from(PIECES),
    st.sampled_from(["UDP", "udp", "TCP", "", " "]),
    st.sampled_from(["utf-8", "utf-8-sig", "latin-1", "utf-16", "utf-16-be", "utf-32-le"]),
    st.sampled_from(["TRUE", "FALSE", "0", "1", "", "no"]),
)
def test_both_readers_judge_any_file_alike(sent, received, before, between, protocol, encoding, only_send):
    text = krc_file(SEND[:3], SIX[:2], only_send=only_send)
    text = text.replace("</ELEMENTS></SEND>", "".join(sent) + between + "</ELEMENTS></SEND>")
    text = text.replace("</ELEMENTS></RECEIVE>", "".join(received) + "</ELEMENTS></RECEIVE>")
    text = before + text.replace("<SENTYPE>", f"<PROTOCOL>{protocol}</PROTOCOL><SENTYPE>")
    judged(text.encode(encoding, "replace"))


@given(st.binary(max_size=40), st.integers(0, 700), st.integers(0, 6))
def test_both_readers_judge_a_damaged_file_alike(piece, at, length):
    data = file()
    judged(data[:at] + piece + data[at + length :])


@pytest.mark.parametrize("name", ["axis-correction.xml", "gantry-correction.xml"])
def test_the_files_that_come_along_are_right(name):
    assert judged((FILES / name).read_bytes()) == ("", "")


class TestValuesThatAreNeverSent:
    FILE = krc_file(SEND, SIX, more=element("Ov.PRO", 20, "LONG", 1))

    async def test_check_the_link_and_the_krc_warn_of_them(self, tmp_path):
        cell = cell_text(tmp_path, file=self.FILE)
        status, out, _ = await run("check", cell)
        assert status == 0
        assert "warning: RECEIVE declares Ov.PRO, which armgate never sends" in " ".join(out.split())
        rig = Rig(tmp_path, file=self.FILE)
        rig.operate("start")
        rig.cycles(3)
        assert sum("Ov.PRO" in note for note in rig.notes) == 1
        assert any("Ov.PRO: 0 until it comes" in text for text in rig.log.texts("zero"))

    def test_what_zero_cannot_harm_is_no_warning(self, tmp_path):
        more = element("DEF_EStr", "INTERNAL", "STRING", 0) + element("RKorr.X", 20, hold=1)
        cell = build_cell(load_config([cell_text(tmp_path, file=krc_file(SEND, SIX, more=more))]))
        assert warnings_of(setup_of(cell, cell.robots[0])) == []


def test_an_ip_number_that_is_no_address_is_named_unless_listen_is_given(tmp_path):
    text = krc_file(SEND, SIX).replace("127.0.0.1", "ip.address.of.rospc")
    cell = build_cell(load_config([cell_text(tmp_path, file=text)]))
    with pytest.raises(ConfigError, match=r"IP_NUMBER 'ip.address.of.rospc' is no address; expected"):
        setup_of(cell, cell.robots[0])
    with pytest.raises(KrcError, match=r"IP_NUMBER 'ip.address.of.rospc' is no address; expected"):
        peer_of(None, krc_reads(text.encode()))
    assert peer_of("127.0.0.1:5", krc_reads(text.encode())).address == ("127.0.0.1", 5)
    cell = build_cell(load_config([cell_text(tmp_path, file=text, listen="127.0.0.1:49152")]))
    assert setup_of(cell, cell.robots[0]).listen == ("127.0.0.1", 49152)

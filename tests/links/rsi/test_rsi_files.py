"""Link, ``armgate check`` and virtual KRC give the same verdict on a file; their readers share no code."""

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
from armgate.emulator.krc.process.options import parse_peer
from armgate.links.rsi.axes import axes_of
from armgate.links.rsi.ethernet_file import EthernetError, read_ethernet
from armgate.links.rsi.setup import setup_of, warnings_of
from armgate.links.rsi.telegram import TelegramError, TelegramReader
from support.clients import run
from support.krcs import FILES, element, krc_file
from support.rsi import SEND, SIX, Rig, cell_text

EXAMPLES = int(os.environ.get("RSI_FILES", "300"))
"""Number of files that are generated for both readers; RSI_FILES=100000 for a long run."""


def link_verdict(data):
    try:
        return read_ethernet(data), ""
    except EthernetError as error:
        return None, str(error)


def krc_verdict(data):
    try:
        return krc_reads(data), ""
    except KrcError as error:
        return None, str(error)


def verdicts(data):
    """Return the errors of both readers, after a check that their verdicts are the same."""
    (ours, refused), (theirs, other) = link_verdict(data), krc_verdict(data)
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
    "index-of-5000-digits": (with_element("SEND", "Other.X", "9" * 5000), "INDX"),
    "port-of-5000-digits": (krc_file(SEND, SIX).replace("49152", "9" * 5000).encode(), "PORT"),
    "long-s-for-s": (krc_file(SEND, SIX).replace("FALSE", "FAL\u017fE").encode(), "ONLYSEND"),
    "long-name": (with_element("SEND", "A" * 65, 9), "64"),
    "name-of-xml": (with_element("SEND", "AIPos.xmlns", 9), "xmlns"),
    "port-twice": (krc_file(SEND, SIX).replace("</PORT>", "</PORT><PORT>1</PORT>").encode(), "PORT"),
    "config-twice": (krc_file(SEND, SIX).replace("<SEND>", "<CONFIG/><SEND>").encode(), "CONFIG"),
    "protocol-twice": (
        krc_file(SEND, SIX)
        .replace("<SENTYPE>", "<PROTOCOL>UDP</PROTOCOL><PROTOCOL>TCP</PROTOCOL><SENTYPE>")
        .encode(),
        "PROTOCOL",
    ),
    "send-twice": (krc_file(SEND, SIX).replace("<SEND>", "<SEND/><SEND>").encode(), "SEND"),
    "elements-twice": (krc_file(SEND, SIX).replace("<SEND>", "<SEND><ELEMENTS/>").encode(), "ELEMENTS"),
    "protocol-in-small-letters": (
        krc_file(SEND, SIX).replace("<SENTYPE>", "<Protocol>TCP</Protocol><SENTYPE>").encode(),
        "Protocol",
    ),
    "element-in-small-letters": (
        with_element("SEND", "X", 9).replace(b'<ELEMENT TAG="X"', b'<Element TAG="X"'),
        "Element",
    ),
    "holdon-in-small-letters": (krc_file(SEND, SIX).replace("HOLDON", "HoldOn", 1).encode(), "HoldOn"),
    "unknown-section": (krc_file(SEND, SIX).replace("<SEND>", "<STATUS/><SEND>").encode(), "STATUS"),
    "unknown-value": (
        krc_file(SEND, SIX).replace("<SENTYPE>", "<CYCLE>4</CYCLE><SENTYPE>").encode(),
        "CYCLE",
    ),
    "unknown-attribute": (krc_file(SEND, SIX).replace("<SEND>", '<SEND RATE="4">').encode(), "RATE"),
    "nested-element": (
        file().replace(b"</ELEMENTS></SEND>", b"<SUB><ELEMENT/></SUB></ELEMENTS></SEND>"),
        "SUB",
    ),
    "text-between-elements": (krc_file(SEND, SIX).replace("<SEND>", "AK.A7<SEND>").encode(), "text"),
    "declares-utf-16": (b'<?xml version="1.0" encoding="UTF-16"?>' + file(), "utf-16"),
    "declares-utf-7": (b"<?xml version='1.0' encoding='utf-7'?>" + file(), "utf-7"),
    "declares-another-code-page": (
        b'<?xml version="1.0" encoding="windows-1252"?>' + file(sentype="R\xfcck"),
        "windows-1252",
    ),
    "no-address": (krc_file(SEND, SIX).replace("127.0.0.1", "").encode(), "IP_NUMBER"),
}


@pytest.mark.parametrize("name", NAMED)
async def test_link_check_and_krc_name_the_error_in_a_file(tmp_path, name):
    data, expected = NAMED[name]
    for text in verdicts(data):
        assert expected.lower() in text.lower()
        assert text
    (tmp_path / "own.xml").write_bytes(data)
    cell = cell_text(tmp_path)
    cell.write_text(cell.read_text().replace("krc.xml", "own.xml"))
    loaded = build_cell(load_config([cell]))
    with pytest.raises(ConfigError, match=r"cell.yaml:\d+: robots.R.link.ethernet") as caught:
        setup_of(loaded, loaded.robots[0])
    assert expected.lower() in str(caught.value).lower()


@pytest.mark.daily(1)
@pytest.mark.parametrize("name", ["TCP", "digit-attribute", "cp1252"])
async def test_the_commands_refuse_the_file_with_status_2(tmp_path, name):
    data, expected = NAMED[name]
    cell = cell_text(tmp_path)
    (tmp_path / "krc.xml").write_bytes(data)
    for arguments in (
        ("check", cell),
        ("krc", "--profile", "krc4-rsi3", "--config", tmp_path / "krc.xml"),
        ("robot-server", cell, "--socket", tmp_path / "s"),
    ):
        status, _, err = await run(*arguments)
        assert status == 2
        assert expected in err
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
        file().replace(b"<ROOT>", b'<ROOT xmlns:x="urn:x" x:schema="y">'),
        file().replace(b'HOLDON="1"', b'HOLDON="1" UNIT="5"'),
        file().replace(b"<SENTYPE>", b"<PROTCOLLENGTH>Off</PROTCOLLENGTH><SENTYPE>"),
    ],
)
def test_link_and_krc_read_the_same_from_a_valid_file(data):
    assert verdicts(data) == ("", "")


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
WORDS = ["PORT", "CONFIG", "SEND", "RECEIVE", "ELEMENTS", "ELEMENT", "HOLDON", "INDX", "TAG", "SENTYPE"]
"""Words of the file; each test replaces one by another spelling."""

SPELLINGS = [str.upper, str.lower, str.capitalize, lambda word: word + "S"]
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
    st.sampled_from(WORDS),
    st.sampled_from(SPELLINGS),
)
def test_both_readers_give_the_same_verdict_on_any_file(
    sent, received, before, between, protocol, encoding, only_send, word, spelling
):
    text = krc_file(SEND[:3], SIX[:2], only_send=only_send)
    text = text.replace("</ELEMENTS></SEND>", "".join(sent) + between + "</ELEMENTS></SEND>")
    text = text.replace("</ELEMENTS></RECEIVE>", "".join(received) + "</ELEMENTS></RECEIVE>")
    text = before + text.replace("<SENTYPE>", f"<PROTOCOL>{protocol}</PROTOCOL><SENTYPE>")
    verdicts(text.encode(encoding, "replace"))
    verdicts(re.sub(rf"\b{word}\b", spelling(word), text).encode(encoding, "replace"))


@given(st.binary(max_size=40), st.integers(0, 700), st.integers(0, 6))
def test_both_readers_give_the_same_verdict_on_a_damaged_file(piece, at, length):
    data = file()
    verdicts(data[:at] + piece + data[at + length :])


@pytest.mark.parametrize("name", ["axis-correction.xml", "gantry-correction.xml"])
def test_the_files_in_the_repository_are_valid(name):
    assert verdicts((FILES / name).read_bytes()) == ("", "")


class TestValuesThatAreNeverSent:
    FILE = krc_file(SEND, SIX, more=element("Ov.PRO", 20, "LONG", 1))

    async def test_check_link_and_krc_warn_of_these_values(self, tmp_path):
        cell = cell_text(tmp_path, file=self.FILE)
        status, out, _ = await run("check", cell)
        assert status == 0
        assert "warning: RECEIVE declares Ov.PRO, which armgate never sends" in " ".join(out.split())
        rig = Rig(tmp_path, file=self.FILE)
        rig.operate("start")
        rig.cycles(3)
        assert sum("Ov.PRO" in note for note in rig.notes) == 1
        assert any("Ov.PRO: 0 until it is received" in text for text in rig.log.texts("zero"))

    def test_a_value_for_which_zero_is_harmless_causes_no_warning(self, tmp_path):
        more = element("DEF_EStr", "INTERNAL", "STRING", 0) + element("RKorr.X", 20, hold=1)
        cell = build_cell(load_config([cell_text(tmp_path, file=krc_file(SEND, SIX, more=more))]))
        assert warnings_of(setup_of(cell, cell.robots[0])) == []


def test_an_ip_number_that_is_not_an_address_is_named_unless_listen_is_given(tmp_path):
    text = krc_file(SEND, SIX).replace("127.0.0.1", "ip.address.of.rospc")
    cell = build_cell(load_config([cell_text(tmp_path, file=text)]))
    with pytest.raises(
        ConfigError, match=r"IP_NUMBER 'ip.address.of.rospc' is not the address of a PC; expected"
    ):
        setup_of(cell, cell.robots[0])
    with pytest.raises(KrcError, match=r"IP_NUMBER 'ip.address.of.rospc' is not the address of a PC"):
        parse_peer(None, krc_reads(text.encode()))
    assert parse_peer("127.0.0.1:5", krc_reads(text.encode())).address == ("127.0.0.1", 5)
    cell = build_cell(load_config([cell_text(tmp_path, file=text, listen="127.0.0.1:49152")]))
    assert setup_of(cell, cell.robots[0]).listen == ("127.0.0.1", 49152)


@pytest.mark.parametrize("host", ["ip.of.pc", "0.0.0.0", "255.255.255.255", "224.0.0.1", "127.000.000.001"])
def test_an_unusable_ip_number_is_refused_or_causes_a_warning_if_the_cell_sets_listen(tmp_path, host):
    text = krc_file(SEND, SIX).replace("127.0.0.1", host)
    cell = build_cell(load_config([cell_text(tmp_path, file=text)]))
    with pytest.raises(
        ConfigError, match=f"IP_NUMBER '{re.escape(host)}' is not the address of a PC; expected"
    ):
        setup_of(cell, cell.robots[0])
    with pytest.raises(KrcError, match=f"IP_NUMBER '{re.escape(host)}' is not the address of a PC"):
        parse_peer(None, krc_reads(text.encode()))
    cell = build_cell(load_config([cell_text(tmp_path, file=text, listen="127.0.0.1:49152")]))
    (warning,) = warnings_of(setup_of(cell, cell.robots[0]))
    assert warning.startswith(f"IP_NUMBER '{host}' in the KRC's file is not the address of a PC")


def test_an_element_named_dat_is_not_mistaken_for_the_erx_form():
    axes = axes_of([(f"A{number}", False) for number in range(1, 7)], {})
    positions = " ".join(f'A{number}="0.0"' for number in range(1, 7))
    body = f"<AIPos {positions}/><ASPos {positions}/><Delay D='0'/><Dat>5</Dat><IPOC>7</IPOC>"
    assert TelegramReader(axes).read(f"<Rob>{body}</Rob>".encode()).ipoc == 7
    with pytest.raises(TelegramError, match="the form of ERX"):
        TelegramReader(axes).read(f"<Rob><Dat>{body}</Dat></Rob>".encode())

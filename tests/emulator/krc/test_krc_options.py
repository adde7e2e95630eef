"""Tests of the command-line options of a virtual KRC."""

from pathlib import Path

import pytest

from armgate.emulator.krc import KrcError, Mode, kr16
from armgate.emulator.krc.context import Limits
from armgate.emulator.krc.process import options
from armgate.emulator.krc.process.network import Disturbance
from support.krcs import ethernet, krc_file

CONFIGS = Path(__file__).parents[3] / "configs"


def test_the_file_is_named_in_errors(tmp_path):
    with pytest.raises(KrcError, match=r"none\.xml: No such file"):
        options.load_ethernet(tmp_path / "none.xml")
    bad = tmp_path / "bad.xml"
    bad.write_text(krc_file().replace("49152", "x"))
    with pytest.raises(KrcError, match=r"bad\.xml: PORT 'x'"):
        options.load_ethernet(bad)
    bad.write_bytes(b" " * 10_000_000)
    with pytest.raises(KrcError, match="expected at most 65536"):
        options.load_ethernet(bad)


def test_a_profile_can_be_selected_with_another_cycle_and_other_lags():
    assert options.select_profile("krc4-rsi3", None).cycle == 0.004
    assert options.select_profile("krc4-rsi3", 12.0).ipoc_step == 12
    other = options.select_profile("krc4-rsi3", None, "A=33,A2=27")
    assert [other.lag_of(axis) for axis in ("A1", "A2", "E1")] == pytest.approx([0.033, 0.027, 0.03])
    with pytest.raises(KrcError, match="limit 'A1=0'"):
        options.select_profile("krc4-rsi3", None, "A1=0")
    with pytest.raises(KrcError, match="no cycle of 5 ms"):
        options.select_profile("krc5-rsi5", 5.0)


def test_the_context_is_read_and_an_unknown_mode_is_refused():
    context = options.parse_context("relative", 3, 100, "A=170,E=2000", "A=171,E=2001", "moves")
    assert (context.mode, context.precision, context.timeout) == (Mode.RELATIVE, 3, 100)
    assert (context.limits["A4"], context.monitor["E6"]) == (170.0, 2001.0)
    with pytest.raises(KrcError, match="mode 'both'; expected absolute or relative"):
        options.parse_context("both", 1, 10, "5", "6")


def test_the_robot_is_built_in_or_from_a_urdf_or_a_cell():
    assert options.load_arm("kr16", [], None).start == kr16().start
    assert options.load_arm("kr16", [], "1, 2,3,4,5,6").start == (1, 2, 3, 4, 5, 6)
    assert options.load_arm(str(CONFIGS / "robots" / "kr16.urdf"), [], None).names == kr16().names
    assert options.load_arm("GR", [CONFIGS / "demo.yaml"], None).names[6:] == ("E1", "E2", "E3")


@pytest.mark.parametrize(
    ("robot", "cell", "start", "text"),
    [
        ("kr17", [], None, "robot 'kr17': no such URDF file"),
        (
            "XY",
            [CONFIGS / "demo.yaml"],
            None,
            "there is no robot 'XY' in cell 'demo'; expected one of FR, GR",
        ),
        (str(CONFIGS / "demo.yaml"), [], None, "not well-formed XML"),
        ("kr16", [], "1,2,x", "expected numbers, joined by commas"),
        ("kr16", [], "1,2", "start with 2 values"),
    ],
)
def test_unusable_robots_are_named_in_the_error(robot, cell, start, text):
    with pytest.raises(KrcError) as caught:
        options.load_arm(robot, cell, start)
    assert text in str(caught.value)


def test_the_address_of_the_pc_comes_from_the_option_or_the_file():
    assert options.parse_peer(None, ethernet()).address == ("127.0.0.1", 49152)
    assert options.parse_peer("127.0.0.1:7", ethernet()).address == ("127.0.0.1", 7)
    assert options.parse_peer("[::1]:8", ethernet()).address == ("::1", 8)
    for wrong in ("localhost", ":5", "127.0.0.1:0", "127.0.0.1:x", "127.0.0.1:70000"):
        with pytest.raises(KrcError, match="expected HOST:PORT"):
            options.parse_peer(wrong, ethernet())


NONE = {"loss": "0", "duplicate": "0", "reorder": "0", "delay": "0", "jitter": "0"}


def test_disturbances_are_read_for_one_direction_or_both():
    both = options.parse_network(**NONE | {"loss": "0.1", "delay": "to-krc=2,to-pc=3"})
    assert both == {"to-pc": Disturbance(loss=0.1, delay=0.003), "to-krc": Disturbance(loss=0.1, delay=0.002)}
    for wrong in ({"loss": "2"}, {"delay": "x"}, {"jitter": "up=3"}, {"delay": "20000"}, {"loss": ""}):
        with pytest.raises(KrcError, match=f"{next(iter(wrong))} .*expected"):
            options.parse_network(**NONE | wrong)


@pytest.mark.parametrize("text", ["1,5", "A1=3,A1=4", "170,A=3,5", "A=3,5"])
def test_a_limit_is_one_number_or_names_every_axis_or_group_once(text):
    with pytest.raises(KrcError, match="expected"):
        Limits.from_text(text, 5.0)


@pytest.mark.parametrize("text", ["1,5", "to-pc=1,to-pc=2", "to-pc=1,5"])
def test_a_disturbance_is_given_once_for_each_direction(text):
    with pytest.raises(KrcError, match=r"expected one number, such as 0\.5"):
        options.parse_network(loss="0", duplicate="0", reorder="0", delay=text, jitter="0")


@pytest.mark.parametrize("robot", ["/dev/zero", "/", "a" * 5000])
def test_devices_folders_and_impossible_names_are_refused_as_urdf(robot):
    with pytest.raises(KrcError, match="no such URDF file; expected kr16"):
        options.load_arm(robot, [], None)

"""Comparison of the joints of the described URDF with those that the monitor reads: live and offline."""

import base64
import hashlib
import json
import math
import re
from pathlib import Path

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.daemon.recording.recorder import Recorder
from armgate.monitor.description_check import differences, joint_differences
from armgate.monitor.model import build
from armgate.monitor.offline import check_recording
from armgate.monitor.yaml_files import read_files
from armgate.protocol import messages as m
from armgate.world.description import CellDescription
from monitor.test_live import config, ended, watching
from monitor.test_offline import rewritten
from monitor.test_planted_faults import A3_ORIGIN, A5, urdf
from monitor.watched import ARM, CONFIGS, GANTRY, Watched, demo, saved
from support.cells import URDF
from support.clients import Process, Raw

ADVICE = "start the daemon and the monitor with the same URDF and configuration"


def described(*files: Path) -> list[str]:
    """Return the differences to the description of a daemon with the same files."""
    library = CellDescription(build_cell(load_config(files)), False)
    return differences(build(read_files(files)), library.description, library.assets.by_hash.__getitem__)


@pytest.mark.parametrize(
    "names",
    [("demo.yaml",), ("planar.yaml",), ("demo.yaml", "links/rsi-virtual.yaml"), ("conformance.yaml",)],
)
def test_the_same_configuration_has_no_difference(names):
    assert described(*(CONFIGS / name for name in names)) == []


TURNS = {
    "quarter about y": (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)),
    "nearly a quarter about y": (1e-9, math.sin(0.785398), 0.0, math.cos(0.785398)),
    "half about x": (1.0, 0.0, 0.0, 0.0),
    "not of length 1": (0.1, -0.2, 0.3, math.sqrt(0.86) + 5e-4),
}


@pytest.mark.parametrize("turn", TURNS)
def test_conversion_of_quaternions_to_angles_is_no_difference(tmp_path, turn):
    """The composed URDF has roll, pitch, yaw; at a pitch of 90° their rounding is largest."""
    text = URDF.read_text().replace("<robot ", '<robot version="1.1" ', 1)
    values = " ".join(map(repr, TURNS[turn]))
    text, count = re.subn(r'<origin xyz="([^"]*)"/>', rf'<origin xyz="\1" quat_xyzw="{values}"/>', text)
    assert count > 0
    (tmp_path / "turned.urdf").write_text(text)
    cell = tmp_path / "cell.yaml"
    cell.write_text("armgate: 1\nname: x\nrobots: {A: {urdf: turned.urdf, start: [0, 0, 0]}}\n")
    assert described(cell) == []


def composed(tmp_path: Path) -> tuple[str, object]:
    """Return the composed URDF of the gantry's robot, with a frame, and the monitor's robot."""
    tree = demo(GANTRY)
    file = saved(tree, tmp_path / "cell.yaml")
    (robot,) = build(read_files([file])).robots
    library = CellDescription(build_cell(load_config([file])), False)
    return library.assets.by_hash[library.description.robots[0].urdf.hash].decode(), robot


def with_origin(text: str, joint: str, origin: str) -> str:
    """Return a URDF in which a joint has another origin."""
    element = re.search(rf'<joint name="{joint}".*?</joint>', text, re.DOTALL)[0]
    changed = re.sub(r"<origin [^>]*/>", "", element).replace("</joint>", f"{origin}</joint>")
    return text.replace(element, changed)


def test_a_moved_joint_is_reported_with_both_values_and_advice(tmp_path):
    text, robot = composed(tmp_path)
    wrong = with_origin(text, "A3", '<origin xyz="0.67 0 0"/>')
    assert list(joint_differences(robot, wrong.encode())) == [
        "GR: joint A3 is described with the origin xyz 0.67 0 0 m, rpy 0 0 0 rad, "
        f"configured as xyz 0.68 0 0 m, rpy 0 0 0 rad; {ADVICE}"
    ]


@pytest.mark.parametrize(("off", "count"), [(5e-8, 0), (2e-7, 1), (-2e-7, 1), (math.nan, 1)])
def test_only_rounding_is_tolerated(tmp_path, off, count):
    text, robot = composed(tmp_path)
    for origin in (f'<origin xyz="{0.68 + off!r} 0 0"/>', f'<origin xyz="0.68 0 0" rpy="0 {off!r} 0"/>'):
        assert len(list(joint_differences(robot, with_origin(text, "A3", origin).encode()))) == count


CHANGES = {
    "an axis is reversed": ('<axis xyz="0 1 0" />', '<axis xyz="0 -1 0" />', "the axis 0 -1 0, conf"),
    "an axis of the gantry": ('<axis xyz="0.0 1.0 0.0" />', '<axis xyz="0.0 1.0 0.1" />', "joint Y is"),
    "the mount of the arm": ('name="gantry_mount"', None, "joint gantry_mount is described with the origin"),
    "a joint slides": ('name="A5" type="revolute"', 'name="A5" type="prismatic"', "the kind prismatic"),
    "a joint is fixed": ('name="A5" type="revolute"', 'name="A5" type="fixed"', "the kind fixed"),
    "a joint has another name": ('joint name="A5"', 'joint name="A7"', "joint A7 is described but not"),
    "another parent": ('<parent link="link_4" />', '<parent link="link_3" />', "the parent link_3"),
    "a joint occurs twice": ('joint name="A5"', 'joint name="A4"', "occurs twice"),
    "a joint is of another type": ('name="A5" type="revolute"', 'name="A5" type="floating"', "'floating'"),
    "it is not a URDF": ("<robot ", "<robots ", "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("name", CHANGES)
def test_every_other_difference_of_a_joint_is_reported(tmp_path, name):
    old, new, said = CHANGES[name]
    text, robot = composed(tmp_path)
    assert old in text
    if new is None:
        wrong = with_origin(text, "gantry_mount", '<origin xyz="0 0 0.001" rpy="0 0 0"/>')
    else:
        wrong = text.replace(old, new, 1)
    found = list(joint_differences(robot, wrong.encode()))
    assert any(said in one for one in found), found
    assert all(ADVICE in one for one in found)


def test_a_described_urdf_that_is_not_text_is_a_difference(tmp_path):
    _, robot = composed(tmp_path)
    (found,) = joint_differences(robot, b"\xff\xfe<robot")
    assert "cannot be read: not a URDF in UTF-8" in found


# --- live -------------------------------------------------------------------------------------------------


@pytest.mark.slow
async def test_a_daemon_with_another_urdf_is_stopped_at_connect(tmp_path):
    """One link is 1 mm shorter in the daemon's URDF; all bodies are the same in the frames of their links."""
    file, wrong = config(tmp_path), tmp_path / "wrong.yaml"
    text = URDF.read_text()
    (tmp_path / "wrong.urdf").write_text(
        text.replace('<origin xyz="0.5 0 0"/>', '<origin xyz="0.499 0 0"/>', 1)
    )
    assert (tmp_path / "wrong.urdf").read_text() != text
    wrong.write_text(file.read_text().replace(str(URDF), str(tmp_path / "wrong.urdf")))
    async with Process.serving(wrong) as daemon:
        observer = await Raw.hello(daemon.port, "observer", "observer")
        async with watching(daemon.port, file) as monitor:
            stopped = await observer.get(m.Stopped)
            assert (stopped.by, set(stopped.robots)) == ("monitor", {"A", "B"})
            assert "A: joint" in stopped.reason
            assert "xyz 0.499 0 0 m" in stopped.reason
            assert "configured as xyz 0.5 0 0 m" in stopped.reason
            status, lines, _ = await ended(monitor)
    assert status == 1
    assert lines[-1].endswith("2 violations")


# --- recordings -------------------------------------------------------------------------------------------


FAULTS = {
    "A3 is described with the origin xyz 0.67 0 0 m": urdf(ARM, A3_ORIGIN, '<origin xyz="0.67 0 0"/>'),
    "A5 is described with the axis 0 -1 0": urdf(ARM, A5, A5.replace("0 1 0", "0 -1 0")),
}


@pytest.mark.parametrize("said", FAULTS)
def test_another_urdf_in_a_recording_is_found_though_the_robot_never_moves(tmp_path, said):
    def wrong(tree):
        tree["folder"] = str(tmp_path)
        FAULTS[said](tree)
        del tree["folder"]

    recorder = Recorder(tmp_path / "run", limit=1 << 30)
    watched = Watched(demo(ARM), tmp_path, wrong=wrong, recorder=recorder)
    watched.rest(3)
    recorder.close()
    _, summary = check_recording(tmp_path / "run", [tmp_path / "true.yaml"], 1.0)
    assert any(said in found.text for found in summary.findings if found.kind == "cell")
    _, summary = check_recording(tmp_path / "run", (), 1.0)  # by its own configuration
    assert summary.findings == []


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    recorder = Recorder(folder / "run", limit=1 << 30)
    Watched(demo(ARM), folder, recorder=recorder).rest(3)
    recorder.close()
    return folder / "run"


def other_urdf(header: dict, *, honest: bool) -> dict:
    """Return a header with another URDF than that of its files; with its own hash if ``honest``."""
    header = json.loads(json.dumps(header))
    reference = header["description"]["robots"][0]["urdf"]
    data = base64.b64decode(header["assets"][reference["hash"]]).replace(b'"0.68 0 0"', b'"0.67 0 0"')
    name = hashlib.sha256(data).hexdigest() if honest else reference["hash"]
    header["assets"] = {name: base64.b64encode(data).decode()}
    reference["hash"] = name
    return header


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda h: other_urdf(h, honest=True), "joint A3 is described with the origin xyz 0.67 0 0 m"),
        (lambda h: other_urdf(h, honest=False), "the recording holds another URDF than the described one"),
        (lambda h: h | {"assets": {}}, "the recording does not hold the described URDF"),
    ],
)
def test_a_changed_description_in_a_recording_is_found(run, tmp_path, change, said):
    changed = rewritten(run, tmp_path / "run", lambda topic, v: change(v) if topic == "/run" else v)
    _, summary = check_recording(changed, (), 1.0)
    assert any(said in found.text for found in summary.findings if found.kind == "cell"), summary.findings

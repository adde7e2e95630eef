"""``armgate monitor RUN``: checks of every state of a recording, and untrusted recordings."""

import base64
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer

from armgate import events as e
from armgate.daemon.recording.recorder import Recorder
from armgate.recording import Recording
from armgate.recording.header import METADATA, PROFILE
from armgate.recording.verify import verify
from monitor.test_planted_faults import DOWN
from monitor.watched import ARM, GANTRY, Watched, demo, saved


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Record the arm on its way down to the floor and its stop in front of it."""
    folder = tmp_path_factory.mktemp("run")
    recorder = Recorder(folder / "run", limit=1 << 30)
    watched = Watched(demo(ARM), folder, recorder=recorder)
    assert watched.toward(DOWN, 120) == []
    recorder.close()
    return folder / "run"


def monitor(*arguments) -> tuple[int, str, str]:
    command = [sys.executable, "-m", "armgate.apps", "monitor", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout, done.stderr


def test_every_state_is_checked_and_counted(run, tmp_path):
    status, out, _ = monitor(run, "--json", tmp_path / "found.json")
    assert status == 0
    shown = sum(topic.startswith("/robots/") for topic, _, _ in Recording.open(run).messages())
    assert (
        out.splitlines()[-1]
        == f"armgate: monitor: {shown} states, {3 * shown} positions checked, no violations"
    )
    found = json.loads((tmp_path / "found.json").read_text())
    assert (found["states"], found["violations"], found["missed"]) == (shown, 0, {})
    assert {one["kind"] for one in found["smallest"]} == {"surroundings", "self"}


@pytest.mark.parametrize(("file", "text"), [("none/found.json", "there is no folder"), (".", "is a folder")])
def test_a_place_for_the_summary_that_cannot_be_written_is_wrong_use_before_the_check(
    run, tmp_path, file, text
):
    place = tmp_path / file
    status, out, err = monitor(run, "--json", place)
    assert (status, out) == (2, "")
    assert err.startswith(f"armgate: --json {place}: {text}")
    status, _, err = monitor("127.0.0.1:9", "cell.yaml", "--json", place)
    assert status == 2
    assert err.startswith(f"armgate: --json {place}: {text}")


def test_violations_of_a_stricter_configuration_are_reported_with_tick_pair_and_numbers(run, tmp_path):
    tree = demo(ARM)
    tree["stop_distance"] = 0.3
    status, out, _ = monitor(run, saved(tree, tmp_path / "strict.yaml"))
    assert status == 1
    assert "violated: stop_distance is described as 0.05; configured as 0.3" in out
    line, *_ = (line for line in out.splitlines() if "violated: FR, tick" in line)
    assert "FR/camera_housing and floor are 2" in line
    assert "mm apart at the stop end of FR; 300.000 mm are required" in line
    assert re.search(r"120 states, 360 positions checked, [0-9]+ violations$", out.splitlines()[-1])


def rewritten(run: Path, folder: Path, change) -> Path:
    """Copy a recording with changed messages: ``change(topic, value)`` returns another value, or None."""
    folder.mkdir()
    with (folder / "recording-0001.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start(PROFILE, library="test")
        channels: dict[str, int] = {}
        recording = Recording.open(run)
        writer.add_metadata(METADATA, {"format": "1"})
        for topic, time, data in recording.messages():
            value = change(topic, json.loads(data))
            if value is None:
                continue
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            ns = recording.header.origin_ns + round(time * 1e9)
            writer.add_message(channels[topic], ns, json.dumps(value).encode(), ns)
        writer.finish()
    return folder


def test_missing_states_are_counted_as_missed(run, tmp_path):
    def without(topic, value):
        return None if topic.startswith("/robots/") and value["tick"] in (20, 21, 40) else value

    status, out, _ = monitor(rewritten(run, tmp_path / "run", without))
    assert status == 0, out
    assert "3 states missed" in out.splitlines()[-1]


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> Path:
    """Record two robots at rest."""
    folder = tmp_path_factory.mktemp("pair")
    recorder = Recorder(folder / "run", limit=1 << 30)
    Watched(demo(ARM, GANTRY), folder, recorder=recorder).rest(10)
    recorder.close()
    return folder / "run"


@pytest.mark.parametrize(("ready", "expected"), [(True, 1), (False, 0)])
def test_a_robot_without_a_state_is_a_violation_if_its_link_was_ready(pair, tmp_path, ready, expected):
    def without(topic, value):
        gone = topic.startswith("/robots/") and value["robot"] == GANTRY
        return None if gone or (topic == "/gate/link" and not ready) else value

    status, out, _ = monitor(rewritten(pair, tmp_path / "run", without))
    assert status == expected, out
    assert "no state received: GR" in out.splitlines()[-1]
    assert ("violated: GR" in out) == ready


@pytest.mark.daily(1)
@pytest.mark.parametrize("told", [True, False])
def test_silence_after_a_link_was_lost_is_no_violation(tmp_path, told):
    recorder = Recorder(tmp_path / "run", limit=1 << 30)
    watched = Watched(demo(ARM, GANTRY), tmp_path, recorder=recorder)
    watched.rest(5)
    if told:
        watched.runner.feed(e.LinkChange(GANTRY, e.LinkState.LOST))
    del watched.links[GANTRY]
    watched.rest(100)
    recorder.close()
    status, out, _ = monitor(tmp_path / "run")
    assert status == (0 if told else 1)
    assert ("violated: GR, tick 4 (0.048 s): no state for" in out) == (not told)


def test_a_repeated_state_after_a_link_change_is_no_violation(tmp_path):
    recorder = Recorder(tmp_path / "run", limit=1 << 30)
    watched = Watched(demo(ARM), tmp_path, recorder=recorder)
    watched.rest(5)
    recorder.show(watched.shown)
    watched.rest(5)
    recorder.close()
    status, out, _ = monitor(tmp_path / "run")
    assert status == 0, out
    assert "10 states, 30 positions checked, no violations" in out


def test_a_broken_hash_chain_is_a_violation(run, tmp_path):
    data = (run / "recording-0001.mcap").read_bytes()
    digest = verify(Recording.open(run)).seals[0].digest.hex().encode()
    assert data.count(digest) == 1
    (tmp_path / "recording-0001.mcap").write_bytes(data.replace(digest, b"0" * len(digest)))
    status, out, _ = monitor(tmp_path)
    assert status == 1
    assert "violated: the recording was changed" in out


def entry(**changes):
    def change(topic, value):
        if topic.startswith("/robots/") and value["tick"] == 50:
            return value | {key: make(value[key]) for key, make in changes.items()}
        return value

    return change


def with_urdf(name):
    """Return the packed configuration with another file as URDF."""

    def change(files):
        text = base64.b64decode(files["config.yaml"]).decode()
        return with_file("config.yaml", re.sub("urdf: .*", f"urdf: {name}", text))(files)

    return change


def header(key, make):
    return lambda topic, value: value | {key: make(value[key])} if topic == "/run" else value


def with_file(name, text):
    return lambda files: files | {name: base64.b64encode(text.encode()).decode()}


@pytest.mark.daily(1)
@pytest.mark.parametrize(
    ("change", "status"),
    [
        (entry(setpoint=lambda q: [q[0] + 0.05, *q[1:]]), 1),
        (entry(q=lambda q: q[:-1]), 1),
        (entry(q=lambda q: ["NaN", *q[1:]]), 1),
        (entry(stop_end=lambda q: [1e308, *q[1:]]), 1),
        (entry(tick=lambda t: t - 30), 1),
        (entry(time=lambda t: t + 1e6), 1),
        (header("files", lambda _: {}), 1),
        (header("files", with_file("config.yaml", "a: [")), 1),
        (header("files", with_file("../escaped", "x")), 1),
        (header("files", lambda f: f | {"config.yaml": "@@@"}), 1),
        (header("files", with_urdf("/dev/zero")), 1),
        (header("files", with_urdf("/etc/hostname")), 1),
        (header("files", with_urdf("../x.urdf")), 1),
        (header("files", with_urdf("package://x/y.urdf")), 1),
        (header("description", lambda _: {}), 1),
        (header("description", lambda d: d | {"stop_distance": 0.01}), 1),
        (header("description", lambda d: d | {"robots": []}), 1),
    ],
)
def test_a_manipulated_recording_is_rejected_or_a_violation(run, tmp_path, change, status):
    got, out, err = monitor(rewritten(run, tmp_path / "run", change))
    assert got == status, (out, err)
    assert "violated" in out or len(err.splitlines()) == 1
    assert not (tmp_path / "escaped").exists()


def test_the_error_of_an_incomplete_recording_names_recover(run, tmp_path):
    data = (run / "recording-0001.mcap").read_bytes()
    (tmp_path / "recording-0001.mcap").write_bytes(data[: len(data) // 2])
    status, _, err = monitor(tmp_path)
    assert status == 1
    assert "armgate recover" in err


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere",), "neither HOST:PORT, unix:PATH nor a recording"),
        (("tests",), "holds no recording"),
        (("127.0.0.1:1",), "no configuration given"),
        (("127.0.0.1:1", "none.yaml"), "none.yaml|no connection"),
        (("README.md",), "not MCAP"),
        ((), "Missing argument"),
    ],
)
def test_wrong_use_is_one_error_with_status_2(arguments, said):
    status, out, err = monitor(*arguments)
    assert (status, out) == (1 if "none.yaml" in arguments else 2, "")
    assert re.search(said, err)

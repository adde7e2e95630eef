"""Hostile recordings: bounded memory, no links followed, only packed files read, one clear error."""

import json
import os
import resource
import subprocess
import sys
import time
from base64 import b64encode

import pytest
import yaml
import zstandard
from mcap.records import Chunk
from mcap.writer import Writer

from armgate.audit.errors import AuditError
from armgate.audit.recorded_cell import recorded_cell
from armgate.audit.recover import recover_recording
from armgate.audit.report import report_page
from armgate.monitor.errors import MonitorError
from armgate.monitor.offline import check_recording
from armgate.recording import DamagedError, ForeignError, Header, Recording, RecordingWriter
from support import records

from .damage import NAME, Content, attempt, whole

MEMORY = 1 << 30


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    return Content(whole(tmp_path_factory.mktemp("whole")))


@pytest.fixture(scope="module")
def header(tmp_path_factory):
    return Recording.open(whole(tmp_path_factory.mktemp("header"))).header


def with_header(folder, header):
    with (folder / NAME).open("xb", buffering=0) as stream:
        RecordingWriter(stream, header).close()
    return folder


def command(*arguments, memory=None):
    def limited():
        if memory is not None:
            resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))

    return subprocess.run(
        [sys.executable, "-m", "armgate.apps", *map(str, arguments)], check=False, capture_output=True,
        text=True,         preexec_fn=limited, timeout=120, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip


def refused(ended):
    """Check that the command ended with a one-line error; return it."""
    assert ended.returncode in (1, 2)
    assert "Traceback" not in ended.stderr
    assert len(ended.stderr.strip().splitlines()) == 1
    return ended.stderr


# --- memory -----------------------------------------------------------------------------------------------


def bomb(file, stated, size=1 << 32, form="zstd"):
    """Write a recording whose chunk of ``size`` zeros states the size ``stated``."""
    data = b""
    if form == "zstd":
        packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
        parts = [packer.compress(bytes(1 << 24)) for _ in range(size >> 24)]
        data = b"".join([*parts, packer.flush()])
    chunk = Chunk(form, data, 1, 0, 0, stated)
    writer = Writer(file)
    writer.start(profile="armgate", library="bomb")
    builder = writer._Writer__record_builder
    chunk.write(builder)
    file.write(builder.end())
    writer.finish()


@pytest.mark.daily(1)
@pytest.mark.parametrize("stated", [1 << 32, 1000, 0, (1 << 64) - 1])
def test_a_decompression_bomb_is_rejected_within_bounded_memory(tmp_path, stated):
    with (tmp_path / NAME).open("wb") as file:
        bomb(file, stated)
    assert (tmp_path / NAME).stat().st_size < 1_000_000
    assert "damaged" in refused(command("report", tmp_path, memory=MEMORY))
    with pytest.raises(DamagedError):
        recover_recording(tmp_path)


def test_a_decompression_bomb_after_a_valid_header_is_rejected(tmp_path, header):
    file = tmp_path / NAME
    with_header(tmp_path, header)
    with (tmp_path / "bomb").open("wb") as stream:
        bomb(stream, 1 << 31, 1 << 31)
    start = (tmp_path / "bomb").read_bytes()
    chunk = start[start.index(b"\x06", 8) :]
    data = file.read_bytes()
    end = data.index(b"\x0f\x04" + bytes(7))  # the end of the data
    file.write_bytes(data[:end] + chunk[: 9 + int.from_bytes(chunk[1:9], "little")] + data[end:])
    assert "armgate writes no such chunk" in refused(command("report", tmp_path, memory=MEMORY))


def test_a_plan_of_a_billion_increments_is_rejected_at_once(tmp_path, content):
    messages = list(content.messages)
    for at, one in enumerate(messages):
        if b'"over"' in one.data:
            value = json.loads(one.data)
            next(out for out in value["outputs"] if "plan" in out)["plan"]["then"] = 10**9
            messages[at] = type(one)(**vars(one) | {"data": json.dumps(value).encode()})
            break
    content.write(tmp_path / NAME, messages, 1 << 14)
    began = time.monotonic()
    with pytest.raises(DamagedError, match="a plan of 1000000000 increments"):
        report_page(Recording.open(tmp_path))
    assert time.monotonic() - began < 20.0


# --- links and devices ------------------------------------------------------------------------------------


def test_a_symbolic_link_in_place_of_the_report_is_replaced_and_its_target_stays(tmp_path):
    folder, target = tmp_path / "run", tmp_path / "precious"
    folder.mkdir()
    target.write_text("precious")
    records.write(folder)
    (folder / "report.html").symlink_to(target)
    ended = command("report", folder)
    assert ended.returncode == 0, ended.stderr
    assert target.read_text() == "precious"
    assert not (folder / "report.html").is_symlink()
    assert "<html" in (folder / "report.html").read_text()


@pytest.mark.parametrize(("file", "text"), [("none/report.html", "there is no folder"), (".", "is a folder")])
def test_a_place_for_the_report_that_cannot_be_written_is_wrong_use_before_the_recording_is_read(
    tmp_path, file, text
):
    ended = command("report", tmp_path / "no-recording", "--out", tmp_path / file)
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"armgate: --out {tmp_path / file}: {text}")


def test_symbolic_links_in_place_of_recovery_files_are_not_followed(tmp_path):
    folder, target = tmp_path / "run", tmp_path / "precious"
    folder.mkdir()
    target.write_text("precious")
    file = records.write(folder, close=False)
    for name in (f".{file.name}.recovering", f"{file.name}.damaged", f".{file.name}"):
        (folder / name).symlink_to(target)
    assert command("recover", folder).returncode == 0
    assert target.read_text() == "precious"


@pytest.mark.parametrize("target", ["elsewhere", "/dev/zero", "/etc/passwd", "nowhere"])
@pytest.mark.parametrize("tool", ["open", "recover"])
def test_a_recording_that_is_a_symbolic_link_is_rejected(tmp_path, tool, target):
    records.write(tmp_path).rename(tmp_path / "elsewhere")
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / NAME).symlink_to(tmp_path / target)
    with pytest.raises(ForeignError, match="symbolic link"):
        recover_recording(folder) if tool == "recover" else Recording.open(folder)


def test_a_pipe_or_a_device_is_rejected_without_waiting(tmp_path):
    os.mkfifo(tmp_path / NAME)
    for path in (tmp_path, tmp_path / NAME, "/dev/zero"):
        with pytest.raises(ForeignError, match="neither a file nor a folder"):
            Recording.open(type(tmp_path)(path))


# --- the packed configuration -----------------------------------------------------------------------------


def changed(header, **files):
    packed = {name: b64encode(data).decode() for name, data in files.items()}
    return header.model_copy(update={"files": header.files | packed})


def config(header, change):
    tree = yaml.safe_load(header.file("config.yaml"))
    change(tree)
    return changed(header, **{"config.yaml": yaml.safe_dump(tree).encode()})


def urdf(tree, value):
    tree["robots"]["A"]["urdf"] = value


def mesh(tree, value):
    tree["surroundings"]["post"]["shape"] = {"mesh": {"file": value}}


def package(tree, value):
    tree["robots"]["A"]["meshes"]["packages"] = {"p": value}


PLACES = (
    "/etc/shadow",
    "/dev/zero",
    "../config.yaml",
    "/proc/self/environ",
    "file:///etc/passwd",
    "a\0b",
    "none",
)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("how", [urdf, mesh, package])
def test_the_configuration_may_refer_only_to_packed_files(header, how, place):
    with pytest.raises(AuditError, match=r"is not packed with it|configuration"):
        recorded_cell(config(header, lambda tree: how(tree, place)))


@pytest.mark.parametrize("place", [*PLACES, "package://p/etc/passwd"])
def test_a_description_may_refer_only_to_packed_files(header, place):
    mesh_ = b'<collision><geometry><mesh filename="%s"/></geometry></collision>' % place.encode()
    more = b'<link name="more">%s</link><link' % mesh_.replace(b"\0", b"&#1;")
    text = header.file("A.urdf").replace(b"<link", more, 1)
    with pytest.raises(AuditError, match=r"is not packed with it|A.urdf|XML"):
        recorded_cell(changed(header, **{"A.urdf": text}))


@pytest.mark.parametrize(
    "name", ["/etc/x", "../x", "..", ".", "", "a\0b", ".hidden", "a\nb", "x" * 300, "a/b"]
)
def test_packed_files_must_have_plain_names(header, name):
    with pytest.raises(AuditError, match="expected a plain name"):
        recorded_cell(changed(header, **{name: b"x"}))


# --- one clear error --------------------------------------------------------------------------------------


def crafted(folder, change, header):
    """Write a recording with an arbitrary header."""
    value = json.loads(header.model_dump_json())
    change(value)
    base = Content(with_header(folder, header) / NAME)
    one = base.messages[0]
    base.messages[0] = type(one)(**vars(one) | {"data": json.dumps(value).encode()})
    base.write(folder / NAME, base.messages, 1 << 20)
    return folder


CRAFTED = {
    "bad base64": lambda h: h["files"].update({"config.yaml": "%%%"}),
    "bad asset": lambda h: h["assets"].update({"x": "a"}),
    "a NUL in a name": lambda h: h["files"].update({"a\0b": ""}),
    "no robots": lambda h: h["description"].update(robots=[]),
    "no description": lambda h: h.update(description={}),
    "no files": lambda h: h.update(files={}),
    "an early time": lambda h: h.update(origin_ns=-1),
    "a late time": lambda h: h.update(origin_ns=10**21),
    "a robot without a name": lambda h: h["description"]["robots"][0].pop("name"),
    "texts for numbers": lambda h: h["description"].update(stop_distance="x"),
}


@pytest.mark.parametrize("what", CRAFTED)
def test_a_manipulated_header_gives_one_clear_error(tmp_path, header, what):
    crafted(tmp_path, CRAFTED[what], header)
    outcomes = {tool: attempt(tool, tmp_path) for tool in ("replay", "view", "report")}
    assert ("refused", None) in outcomes.values()
    assert {outcome for outcome, _ in outcomes.values()} <= {"refused", "read"}


def test_names_are_not_parsed_as_formulas(tmp_path):
    value = records.header().model_dump()
    with (tmp_path / NAME).open("xb", buffering=0) as stream:
        sink = RecordingWriter(stream, Header(**value | {"cell": "$\\frac{"}))
        for k in range(20):
            for time_, item in records.tick_items(k):
                sink.put(item, time_)
        sink.close()
    content = Content(tmp_path / NAME)
    renamed = [
        type(one)(**vars(one) | {"data": one.data.replace(b'"s":{', b'"$\\\\frac{ \\u202e\\u001b[2J _":{')})
        for one in content.messages
    ]
    content.write(tmp_path / NAME, renamed, 1 << 20)
    text = report_page(Recording.open(tmp_path))
    assert "Signals" in text
    assert "\u202e" not in text
    assert "\x1b" not in text


@pytest.mark.parametrize("place", ["/dev/zero", "/etc/hostname", "../x.urdf"])
def test_the_monitor_reads_packed_files_only(tmp_path, header, place):
    with_header(tmp_path, config(header, lambda tree: urdf(tree, place)))
    with pytest.raises(MonitorError, match="is not a file of the recording"):
        check_recording(tmp_path, (), 1.0)


def test_the_monitor_reads_packed_meshes_only(tmp_path, header):
    mesh_ = b'<collision><geometry><mesh filename="/dev/zero"/></geometry></collision></link>'
    text = header.file("A.urdf").replace(b"</link>", mesh_, 1)
    with_header(tmp_path, changed(header, **{"A.urdf": text}))
    with pytest.raises(MonitorError, match="is not a file of the recording"):
        check_recording(tmp_path, (), 1.0)

"""Damaged and hostile recordings, made from a complete one: changed bytes, records and JSON fields.

``CASES=10000 python tests/audit/damage.py`` tries that number of recordings. Every offline tool must
either read a recording or refuse it with one clear error.
"""

import contextlib
import io
import json
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
from base64 import b64decode, b64encode
from pathlib import Path

from mcap.records import Channel, Message, Schema
from mcap.writer import CompressionType, Writer

from armgate.apps.cli import explain as error_text
from armgate.apps.view.player import Player
from armgate.apps.view.scene import Scene
from armgate.audit.explain import explanation, first_refusals, selected_commands
from armgate.audit.explain_picture import draw_explanation
from armgate.audit.recorded_cell import recorded_cell
from armgate.audit.recover import recover_recording
from armgate.audit.replay import replay_recording
from armgate.audit.report import report_page
from armgate.events import Tick
from armgate.protocol import messages as m
from armgate.recording import CellState, Gap, LogLine, Recording, RecordingWriter, RobotState
from armgate.recording.scan import records, scan
from armgate.recording.verify import verify
from support.cells import arms_yaml
from support.gate_runs import record_run

NAME = "recording-0001.mcap"
TOOLS = ("open", "replay", "explain", "recover", "view", "audit", "report")
VALUES = (
    None, True, -1, 0, 1, 1.5, 1e308, -1e308, 5e-324, "NaN", "Infinity", "-Infinity", 2**31, 2**53 + 1, 2**63,
    2**64, 2**200, "", "a\0b", "$\\frac{1}$", "\x1b[2J\n", "\u202ex", "../../x", "/etc/shadow", "/dev/zero",
    "x" * 5000, [], {}, [[]], [None], {"": None}, [1e308] * 3, "_x",
    "%s{0}", "𝕏", "A", "B", ".", "..", "=", "\t",
)  # fmt: skip


def commands(k):
    """Return the commands of a step: A turns into the post, B exceeds its speed."""
    return {"A": (-0.004, 0.0, 0.0), "B": (0.0, 9.0 if k == 20 else 0.0, 0.0)} if k > 2 else {}


def whole(folder: Path) -> Path:
    """Record a run with a refused command; return its file."""
    from armgate.cell.cell import build_cell
    from armgate.cell.config import load_config

    file = folder / "arms.yaml"
    file.write_text(arms_yaml().replace("[0.6, 0.9, 0.5]", "[0.9, 0.0, 0.5]"))
    record_run(build_cell(load_config([file])), folder / "run", 60, commands).close()
    return _with_states(folder / "run" / NAME, folder / NAME)


def _with_states(file: Path, new: Path) -> Path:
    """Add states, log lines, and an empty gap."""
    recording = Recording.open(file)
    with new.open("wb", buffering=0) as stream:
        sink = RecordingWriter(stream, recording.header)
        for time_, step in recording.steps():
            sink.put(step, time_)
            if isinstance(step.event, Tick):
                for item in _states(step.event):
                    sink.put(item, time_)
        sink.put(LogLine(1.7e9, "warning", "late", {"by": [1.0, "x"], "robot": "A"}), time_)
        sink.put(Gap(1, 0), time_)
        sink.close()
    return new


def _states(tick: Tick):
    near = m.Nearest(pair=("A/tip", "post"), distance=0.1, limit=0.02, points=((0, 0, 0), (0, 0, 0.1)))
    yield RobotState(
        m.Entry(
            robot=tick.robot, tick=tick.tick, time=tick.time, q=tick.q, setpoint=tick.setpoint,
            nearest=(near,), holder="leader", stops=(1,), counts={"admitted": 3, "refused:clearance": 1},
        )
    )  # fmt: skip
    signals = {"lead.progress": m.SignalValue(owner="leader", value=(0.5,), time=tick.time)}
    yield CellState(tick.time, None, {tick.robot: tick.tick}, signals, ("late",))


class Content:
    """Records of a file."""

    def __init__(self, file: Path) -> None:
        self.data = file.read_bytes()
        self.schemas, self.channels, self.messages = [], [], []
        for place in scan(file).chunks:
            for record in records(place):
                match record:
                    case Schema():
                        self.schemas.append(record)
                    case Channel():
                        self.channels.append(record)
                    case Message():
                        self.messages.append(record)

    def write(self, file: Path, messages, size: int) -> None:
        with file.open("wb") as stream:
            writer = Writer(stream, chunk_size=size, compression=CompressionType.ZSTD)
            writer.start(profile="armgate", library="damage")
            for schema in self.schemas:
                writer.register_schema(schema.name, schema.encoding, schema.data)
            for channel in self.channels:
                writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id)
            for one in messages:
                writer.add_message(one.channel_id, one.log_time, one.data, one.publish_time, one.sequence)
            writer.finish()


def damage(content: Content, file: Path, chance: random.Random) -> str:
    """Write a damaged recording; return a description of the damage."""
    kind = chance.choice(("bytes", "records", "field", "field", "field", "header", "config"))
    if kind == "bytes":
        data = bytearray(content.data)
        what = _bytes(data, chance)
        file.write_bytes(data)
        return what
    messages = list(content.messages)
    if kind == "records":
        what = _records(messages, chance)
    else:
        header = kind in ("header", "config")
        at = 0 if header else chance.randrange(len(messages))
        value = json.loads(messages[at].data)
        what = _config(value, chance) if kind == "config" else _field(value, chance)
        messages[at] = _with(messages[at], data=json.dumps(value).encode())
    content.write(file, messages, chance.choice((1 << 10, 1 << 14, 1 << 20)))
    return what


def _with(message, **more):
    return Message(**(vars(message) | more))


def _bytes(data: bytearray, chance: random.Random) -> str:
    at = chance.randrange(len(data))
    length = chance.choice((1, 1, 2, 8, 100, 3000))
    what = chance.choice(("flip", "zero", "garbage", "cut", "insert", "repeat", "tail"))
    match what:
        case "flip":
            data[at] ^= 1 << chance.randrange(8)
        case "zero":
            data[at : at + length] = bytes(min(length, len(data) - at))
        case "garbage":
            data[at : at + length] = chance.randbytes(min(length, len(data) - at))
        case "cut":
            del data[at : at + length]
        case "insert":
            data[at:at] = chance.randbytes(length)
        case "repeat":
            data[at:at] = data[at : at + length]
        case "tail":
            data[at:] = chance.choice((b"", bytes(len(data) - at), chance.randbytes(len(data) - at)))
    return f"{what} {length} bytes at {at}"


def _records(messages: list, chance: random.Random) -> str:
    at, other = (chance.randrange(len(messages)) for _ in range(2))
    what = chance.choice(("drop", "repeat", "swap", "topic", "time", "sequence", "garbage", "cut", "json"))
    one = messages[at]
    match what:
        case "drop":
            del messages[at]
        case "repeat":
            messages[at:at] = [one] * chance.choice((1, 5))
        case "swap":
            messages[at], messages[other] = messages[other], one
        case "topic":
            messages[at] = _with(one, channel_id=messages[other].channel_id)
        case "time":
            messages[at] = _with(one, log_time=chance.choice((0, 1, 2**63, 2**64 - 1)))
        case "sequence":
            messages[at] = _with(one, sequence=chance.choice((0, 2**32 - 1)))
        case "garbage":
            messages[at] = _with(one, data=chance.randbytes(chance.choice((0, 1, 100))))
        case "cut":
            messages[at] = _with(one, data=one.data[: chance.randrange(len(one.data))])
        case "json":
            deep = chance.choice((b"[" * 5000, b"null", b"{}", b"[]", b"1e999", b'"\xff"', b'{"a":1,"a":2}'))
            messages[at] = _with(one, data=deep)
    return f"{what} record {at}"


def _field(value, chance: random.Random) -> str:
    """Change one field at any depth."""
    path = []
    while True:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        if not keys:
            return "nothing"
        key = chance.choice(keys)
        path.append(key)
        if not isinstance(value[key], dict | list) or not value[key] or chance.random() < 0.15:
            break
        value = value[key]
    what = chance.choice(("set", "set", "set", "remove", "add", "nest"))
    new = chance.choice(VALUES)
    match what:
        case "set":
            value[key] = new
        case "remove":
            del value[key]
        case "add" if isinstance(value, dict):
            value[chance.choice(("x", "", "\0", "$x$", "A"))] = new
        case "add":
            value.extend([new] * chance.choice((1, 100)))
        case "nest":
            value[key] = [value[key]]
    return f"{what} {path} {new!r:.40}"


def _config(value, chance: random.Random) -> str:
    """Change the packed configuration or a robot description as text."""
    name = chance.choice(list(value["files"]))
    lines = b64decode(value["files"][name]).decode().split("\n")
    at = chance.randrange(len(lines))
    what = chance.choice(("drop", "repeat", "value", "word"))
    match what:
        case "drop":
            del lines[at]
        case "repeat":
            lines[at:at] = [lines[at]] * 3
        case "value":
            lines[at] = f"{lines[at].partition(':')[0]}: {json.dumps(chance.choice(VALUES))}"
        case "word":
            parts = lines[at].split(" ")
            parts[chance.randrange(len(parts))] = str(chance.choice(VALUES))
            lines[at] = " ".join(parts)
    value["files"][name] = b64encode("\n".join(lines).encode()).decode()
    return f"{what} line {at} of {name}: {lines[min(at, len(lines) - 1)]!r:.60}"


def use(tool: str, folder: Path) -> None:
    """Run a tool on a recording as its command does."""
    match tool:
        case "open":
            for _ in Recording.open(folder).items():
                pass
        case "replay":
            recording = Recording.open(folder)
            replay_recording(recording, recorded_cell(recording.header))
        case "explain":
            recording = Recording.open(folder)
            cell = recorded_cell(recording.header)
            for number, case in enumerate(selected_commands(recording, cell, first_refusals(None))):
                explanation(case, cell)
                if number < 1:
                    draw_explanation(case, cell, folder / "x.png")
        case "recover":
            copy = folder / "copy"
            copy.mkdir()
            shutil.copy(folder / NAME, copy)
            recover_recording(copy)
            use("open", copy)
        case "view":
            player = Player(folder)
            Scene.build(player.description, player.asset, meshes=False)
            for share in (0.0, 0.5, 1.0):
                player.seek(share * player.length)
                state = player.newest()
                if state is not None:
                    player.describe(state)
        case "audit":
            for found in verify(Recording.open(folder)).breaks:
                str(found)
        case "report":
            report_page(Recording.open(folder))


def attempt(tool: str, folder: Path) -> tuple[str, str | None]:
    """Run a tool; return its outcome, and the traceback or text of a defect."""
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            use(tool, folder)
    except Exception as error:
        text = error_text(error)
        if text is None:
            return "defect", traceback.format_exc()
        if tool != "recover" and len(text) > 2000:
            return "defect", f"an error of {len(text)} characters: {text[:200]}"
        return "refused", None
    return "read", None


def tried(content: Content, seed: int, tools=TOOLS) -> list[str]:
    """Damage a recording and run the tools on it; return the defects."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        what = damage(content, Path(name) / NAME, random.Random(seed))
        for tool in tools:
            began = time.monotonic()
            outcome, defect = attempt(tool, Path(name))
            if outcome == "defect":
                found.append(f"case {seed}, {what}: {tool}: {defect}")
            if time.monotonic() - began > 30.0:
                found.append(f"case {seed}, {what}: {tool} took {time.monotonic() - began:.0f} s")
    return found


def main() -> int:
    """Run many cases; print each kind of defect once."""
    first, count = int(os.environ.get("FIRST", "0")), int(os.environ.get("CASES", "1000"))
    kinds = set()
    with tempfile.TemporaryDirectory() as name:
        content = Content(whole(Path(name)))
        for seed in range(first, first + count):
            tools = TOOLS if seed % 8 == 0 else TOOLS[:-1]
            for defect in tried(content, seed, tools):
                kind = defect.strip().split("\n")[-1] + "".join(defect.strip().split("\n")[-3:-2])
                if kind not in kinds:
                    kinds.add(kind)
                    print(defect, flush=True)  # noqa: T201
    print(f"{count} damaged recordings, {len(kinds)} kinds of defects")  # noqa: T201
    return 1 if kinds else 0


if __name__ == "__main__":
    sys.exit(main())

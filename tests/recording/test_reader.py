"""Reader of recordings: complete, truncated, damaged and foreign files, and other versions."""

import random

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from armgate.recording import (
    DamagedError,
    ForeignError,
    Gap,
    IncompleteError,
    NewerFormatError,
    Recording,
    RecordingWriter,
    StateSeries,
    Step,
    TruncatedError,
    part_name,
    writer,
)
from armgate.recording.files import atomic_write
from armgate.recording.recover import Recovery, recover_file
from armgate.recording.scan import scan
from support import records


def ticks(recording):
    return [step.event.tick for _, step in recording.steps()]


def test_items_are_read_in_order_over_all_parts(tmp_path):
    records.write(tmp_path, range(60), part=1)
    records.write(tmp_path, range(60, 130), part=2)
    recording = Recording.open(tmp_path)
    assert ticks(recording) == list(range(130))
    assert recording.whole
    assert recording.header == records.header()
    written = [item for k in range(130) for item in records.tick_items(k)]
    read = list(recording.items())
    assert [item for _, item in read] == [item for _, item in written]
    assert [time for time, _ in read] == pytest.approx([time for time, _ in written], abs=1e-8)


def test_general_mcap_tools_read_the_schemas_and_the_index(tmp_path):
    path = records.write(tmp_path)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        found = list(reader.iter_messages(topics=["/gate/tick"]))
    assert [message.sequence for _, _, message in found] == sorted(m.sequence for _, _, m in found)
    assert len(found) == 100
    links = len(scan(path).chunks) - 1
    assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}
    assert summary.statistics.message_count == 1 + 100 * 3 + 2 + links


def offsets(path):
    """Return the bytes of a file, and offsets at which to truncate it."""
    whole = path.read_bytes()
    borders = {place.offset - 9 for place in scan(path).chunks} | {
        place.offset + place.length for place in scan(path).chunks
    }
    near = {border + d for border in borders for d in (-1, 0, 1, 5, 20)}
    within = random.Random(7).sample(range(len(whole)), 20)
    return whole, sorted({n for n in {*near, *within, *range(12)} if 0 <= n < len(whole)})


def test_a_file_truncated_anywhere_keeps_all_complete_chunks_and_is_recovered(tmp_path):
    path = records.write(tmp_path, range(24), close=True)
    before = list(Recording.open(path).items())
    whole, places = offsets(path)
    header_at = scan(path).chunks[0]
    for place in places:
        path.write_bytes(whole[:place])
        if place < header_at.offset + header_at.length:
            with pytest.raises(TruncatedError, match="nothing can be recovered"):
                Recording.open(path, partial=True)
            continue
        with pytest.raises(TruncatedError, match="recover"):
            Recording.open(path)
        partial = list(Recording.open(path, partial=True).items())
        flushed = sum(c.offset + c.length <= place for c in scan(path).chunks) - 1
        assert partial == before[: len(partial)]
        assert sum(isinstance(item, Step) for _, item in partial) == 8 * flushed
        new = tmp_path / "new.mcap"
        with atomic_write(new) as stream:
            result = recover_file(path, stream)
        assert list(Recording.open(new).items()) == partial
        assert result == Recovery(len(partial) + 1, place - scan(path).good, 0)


def test_damage_in_the_middle_is_reported_with_its_byte(tmp_path):
    path = records.write(tmp_path)
    place = scan(path).chunks[3]
    data = bytearray(path.read_bytes())
    data[place.offset + place.length // 2] ^= 0x10
    path.write_bytes(data)
    with pytest.raises(DamagedError, match=f"byte {place.offset}"):
        list(Recording.open(path).items())


def other_mcap(path, profile="", start=True):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile=profile)
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()


@pytest.mark.parametrize("data", [b"hello", b"\x89PNG\r\n\x1a\n" + bytes(50), b"{}" * 100])
def test_a_file_that_is_not_mcap_is_foreign(tmp_path, data):
    path = tmp_path / part_name(1)
    path.write_bytes(data)
    with pytest.raises(ForeignError, match="expected a recording of armgate"):
        Recording.open(path)


def test_mcap_of_another_program_is_foreign(tmp_path):
    other_mcap(tmp_path / part_name(1), "ros2")
    with pytest.raises(ForeignError, match="'ros2'"):
        Recording.open(tmp_path)
    other_mcap(tmp_path / part_name(1), "armgate")
    with pytest.raises(DamagedError, match="header"):
        Recording.open(tmp_path)


def test_an_empty_or_missing_folder_is_named(tmp_path):
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(ForeignError, match=str(path)):
            Recording.open(path)


def test_a_newer_format_is_refused_with_advice(tmp_path):
    path = records.write(tmp_path, format=2)
    with pytest.raises(NewerFormatError, match="format 2; this version reads up to 1; use a later version"):
        Recording.open(path)


@pytest.mark.parametrize("other", [{"start": "beef"}, {"hash": "f" * 64}])
def test_parts_of_two_runs_in_a_folder_are_refused(tmp_path, other):
    records.write(tmp_path, part=1)
    records.write(tmp_path, part=2, **other)
    with pytest.raises(IncompleteError, match="not of the same run"):
        Recording.open(tmp_path)


def test_a_missing_part_is_named(tmp_path):
    for part in (1, 3):
        records.write(tmp_path, range(20 * part, 20 * part + 20), part=part)
    with pytest.raises(IncompleteError, match="part 2 is missing"):
        Recording.open(tmp_path)


def test_without_its_first_part_a_recording_has_states_but_no_steps(tmp_path):
    records.write(tmp_path, range(50, 99), part=2)
    recording = Recording.open(tmp_path)
    assert StateSeries(recording).at(1e9).tick == 98
    with pytest.raises(IncompleteError, match="begins with part 2"):
        next(recording.steps())


def test_steps_end_at_a_gap_of_events(tmp_path):
    path = tmp_path / part_name(1)
    stream = records.File(path)
    writer = RecordingWriter(stream, records.header())
    for item in (*records.tick_items(1), (0.02, Gap(3, 0)), *records.tick_items(2), (0.05, Gap(3, 2))):
        writer.put(item[1], item[0])
    writer.close()
    stream.file.close()
    steps = Recording.open(path).steps()
    assert [next(steps)[1].event.tick, next(steps)[1].event.tick] == [1, 2]
    with pytest.raises(IncompleteError, match=r"2 of the gate's events were lost at 0\.050 s"):
        next(steps)


# --- states at any time -----------------------------------------------------------------------------------


def test_the_state_at_any_time_is_the_newest_before_it(tmp_path):
    records.write(tmp_path, range(40), part=1)
    records.write(tmp_path, range(40, 100), part=2, close=False)
    series = StateSeries(Recording.open(tmp_path, partial=True))
    last = 95  # later ticks were not flushed
    assert (series.start, series.end) == (pytest.approx(0.0), pytest.approx(last * 0.012))
    assert series.at(-1.0) is None
    random.seed(3)
    for time in [0.0, 0.0119, 0.012, *(random.uniform(0, 1.2) for _ in range(50)), 99.0]:
        k = min(int(time / 0.012 + 1e-6), last)
        state = series.at(time + 1e-9)
        assert (state.robot, state.tick, state.entries[0].tick) == ("A", k, k)
        assert state.signals["s"].value == (float(k),)
    assert [state.tick for state in series.all()] == list(range(last + 1))


def test_a_header_too_large_for_readers_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "LARGEST", 10_000)
    with (
        (tmp_path / "x").open("wb") as stream,
        pytest.raises(OSError, match="more than a recording can hold"),
    ):
        RecordingWriter(stream, records.header(assets={"a": "A" * 6000}))


def test_a_robot_that_never_ticked_has_no_position(tmp_path):
    one = records.header()
    robots = one.description["robots"]
    description = one.description | {"robots": [*robots, robots[0] | {"name": "B"}]}
    records.write(tmp_path, description=description)
    state = StateSeries(Recording.open(tmp_path)).at(0.5)
    assert [(entry.robot, entry.q is None) for entry in state.entries] == [("A", False), ("B", True)]

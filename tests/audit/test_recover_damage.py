"""Recovery of damaged files: everything readable is kept, and losses are reported and marked."""

import random

import pytest

from armgate.audit.recover import recover_recording
from armgate.recording import Gap, IncompleteError, Recording, RecordingError, Step
from armgate.recording.scan import scan
from support import records
from support.clients import run


def ticks(folder):
    items = [item for _, item in Recording.open(folder).items()]
    return [item.event.tick for item in items if isinstance(item, Step)]


def gaps(folder):
    return [item for _, item in Recording.open(folder).items() if isinstance(item, Gap)]


def damaged(folder, change, count=200, **how):
    """Write a recording, change its bytes with ``change(data, chunks)``, and return its file."""
    folder.mkdir(exist_ok=True)
    file = records.write(folder, range(count), **how)
    chunks, data = scan(file).chunks, bytearray(file.read_bytes())
    change(data, chunks)
    file.write_bytes(data)
    return file


TAILS = {
    "zeros": bytes,
    "garbage": lambda n: random.Random(3).randbytes(n),
    "ones": lambda n: b"\xff" * n,
    "magic": lambda n: (b"\x89MCAP0\r\n" * n)[:n],
}


@pytest.mark.daily(12)
@pytest.mark.parametrize("tail", TAILS)
@pytest.mark.parametrize("length", [1, 9, 40, 2000])
@pytest.mark.parametrize("instead", [True, False], ids=["in place of the end", "after the end"])
def test_a_damaged_end_is_removed(tmp_path, tail, length, instead):
    bad = TAILS[tail](length)

    def over(data, _):
        data[len(data) - instead * length :] = bad

    file = damaged(tmp_path / "bad", over, close=False)
    data = file.read_bytes()
    cut = damaged(tmp_path / "cut", lambda data, _: None, close=False)
    cut.write_bytes(data[: len(data) - length])
    recover_recording(tmp_path / "bad")
    recover_recording(tmp_path / "cut")
    assert ticks(tmp_path / "bad") == ticks(tmp_path / "cut") != []
    assert gaps(tmp_path / "bad") == []


def flip(offset):
    def change(data, chunks):
        data[chunks[5].offset + offset] ^= 0x55

    return change


@pytest.mark.parametrize("close", [True, False])
@pytest.mark.parametrize(
    "change", [flip(100), flip(-1), flip(-9), flip(-5), flip(20), flip(30)],
    ids=["data", "length", "kind", "longer", "size", "compression"],
)  # fmt: skip
def test_a_damaged_chunk_in_the_middle_is_skipped_and_counted_in_a_gap(tmp_path, close, change):
    file = damaged(tmp_path, change, close=close)
    before = file.read_bytes()
    (one,) = recover_recording(tmp_path)
    # Chunk 0 is the header, each further one holds eight ticks.
    assert ticks(tmp_path) == [k for k in range(200) if k // 8 != 4]
    (gap,) = gaps(tmp_path)
    assert gap.records == one.result.lost >= 24
    assert one.original.read_bytes() == before
    with pytest.raises(IncompleteError, match="were lost at"):
        list(Recording.open(tmp_path).steps())


def test_damage_outside_of_messages_loses_no_message(tmp_path):
    def index(data, chunks):
        data[chunks[5].end : chunks[5].end + 4] = b"\x00\x00\x00\x00"

    damaged(tmp_path, index)
    (one,) = recover_recording(tmp_path)
    assert (one.result.lost, one.original, gaps(tmp_path)) == (0, None, [])
    assert ticks(tmp_path) == list(range(200))


def test_two_damaged_places_leave_two_gaps(tmp_path):
    def two(data, chunks):
        for k in (3, 4, 9):
            data[chunks[k].offset + 80] ^= 0xFF

    damaged(tmp_path, two)
    recover_recording(tmp_path)
    assert len(gaps(tmp_path)) == 2


def test_a_file_that_is_damaged_again_keeps_both_originals(tmp_path):
    damaged(tmp_path, flip(100))
    (one,) = recover_recording(tmp_path)
    file = one.file
    data = bytearray(file.read_bytes())
    data[scan(file).chunks[9].offset + 90] ^= 0xFF
    file.write_bytes(data)
    (two,) = recover_recording(tmp_path)
    assert [one.original.name, two.original.name] == [f"{file.name}.damaged", f"{file.name}.damaged-2"]


def zeros(data, chunks):
    """Fill every chunk with zeros, as after a power failure."""
    for chunk in chunks:
        data[chunk.offset : chunk.end] = bytes(chunk.end - chunk.offset)


def test_a_file_of_which_nothing_can_be_read_stays_unchanged(tmp_path):
    file = damaged(tmp_path, zeros, close=False)
    before = file.read_bytes()
    with pytest.raises(RecordingError, match="nothing can be recovered"):
        recover_recording(tmp_path)
    assert [(f.name, f.read_bytes()) for f in tmp_path.iterdir()] == [(file.name, before)]


async def test_a_last_part_of_which_nothing_can_be_read_is_set_aside(tmp_path):
    records.write(tmp_path, range(40))
    file = damaged(tmp_path, zeros, part=2, close=False)
    before = file.read_bytes()
    status, text, _ = await run("recover", tmp_path)
    kept = tmp_path / f"{file.name}.damaged"
    assert (status, kept.read_bytes()) == (0, before)
    assert "no message can be read; the damaged file is kept as" in text
    assert ticks(tmp_path) == list(range(40))


async def test_the_command_prints_what_was_lost(tmp_path):
    damaged(tmp_path, flip(100))
    status, text, _ = await run("recover", tmp_path)
    assert status == 0
    assert "more were lost by damage and are counted in a gap" in text
    assert "kept as recording-0001.mcap.damaged" in text
    status, text, _ = await run("recover", tmp_path)
    assert (status, text.strip().endswith("complete, nothing to recover")) == (0, True)

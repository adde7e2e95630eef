"""Hash chain of a recording: changed, removed and inserted bytes are found, with their place."""

import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk

from armgate.recording import Recording, RecordingWriter, part_name
from armgate.recording.chain import ChainWriter
from armgate.recording.scan import PREFIX, scan
from armgate.recording.verify import verify
from support import records


def written(folder: Path, parts=1, ticks=160, signer=None):
    """Write a recording of some parts; each header contains the seal of the previous part."""
    folder.mkdir(exist_ok=True)
    previous = ""
    for part in range(1, parts + 1):
        stream = records.File(folder / part_name(part))
        writer = RecordingWriter(stream, records.header(part, previous=previous), signer)
        for k in range(ticks * (part - 1), ticks * part):
            for time, item in records.tick_items(k):
                writer.put(item, time)
            if k % 8 == 7:
                writer.flush()
        previous = writer.close(last=part == parts).digest.hex()
        stream.file.close()
    return folder


def change(folder, edit, part=1):
    """Edit the bytes of a file."""
    file = folder / part_name(part)
    chunks, data = scan(file).chunks, bytearray(file.read_bytes())
    file.write_bytes(edit(data, chunks) or data)
    return chunks


def repacked(data, place, old, new):
    """Return a valid chunk with changed messages."""
    content = data[place.offset : place.end]
    at = content.index(b"zstd") + 12
    inside = zstandard.ZstdDecompressor().decompress(bytes(content[at:])).replace(old, new)
    builder = RecordBuilder()
    packed = zstandard.compress(inside)
    Chunk("zstd", packed, place.last_ns, place.first_ns, zlib.crc32(inside), len(inside)).write(builder)
    return builder.end()


def test_a_recording_is_intact_over_all_its_parts(tmp_path):
    chain = verify(Recording.open(written(tmp_path, parts=3)))
    assert (chain.breaks, chain.unsealed, len(chain.seals)) == ((), (), 3)
    assert chain.links == 3 * 21  # 20 chunks after the header's, each with a link, and a seal


def test_the_chain_covers_chunks_that_end_without_a_flush(tmp_path):
    stream = records.File(tmp_path / part_name(1))
    writer = RecordingWriter(stream, records.header())
    for k in range(6000):  # more than a chunk holds
        for time, item in records.tick_items(k):
            writer.put(item, time)
    writer.close()
    stream.file.close()
    assert len(scan(tmp_path / part_name(1)).chunks) > 3
    assert verify(Recording.open(tmp_path)).breaks == ()

    def edit(data, chunks):
        data[chunks[2].begin : chunks[2].end] = repacked(data, chunks[2], b'"owner":"x"', b'"owner":"y"')

    change(tmp_path, edit)
    assert len(verify(Recording.open(tmp_path)).breaks) == 1


@pytest.mark.parametrize("k", [0, 1, 7, 20])
def test_a_changed_message_breaks_only_the_link_of_its_chunk(tmp_path, k):
    def edit(data, chunks):
        old = (b'"start":"feed"', b'"start":"beef"') if k == 0 else (b'"owner":"x"', b'"owner":"y"')
        new = repacked(data, chunks[k], *old)
        assert new != data[chunks[k].begin : chunks[k].end]
        data[chunks[k].begin : chunks[k].end] = new

    chunks = change(written(tmp_path), edit)
    chain = verify(Recording.open(tmp_path))
    (found,) = chain.breaks
    assert chain.links == 20
    assert found.first <= chunks[k].begin < found.end
    assert k == 0 or found.first == chunks[k].begin
    assert found.time == pytest.approx(0.0 if k == 0 else 0.012 * 8 * (k - 1), abs=0.02)


@pytest.mark.parametrize("what", ["remove", "swap", "repeat", "insert"])
def test_removed_moved_and_inserted_chunks_are_found(tmp_path, what):
    def edit(data, chunks):
        a, b, c = (chunks[k].begin for k in (5, 6, 7))
        first, second = data[a:b], data[b:c]
        middle = {
            "remove": second, "swap": second + first, "repeat": first + first + second,
            "insert": repacked(data, chunks[9], b"{", b"{") + first + second,
        }  # fmt: skip
        return data[:a] + middle[what] + data[c:]

    change(written(tmp_path), edit)
    assert verify(Recording.open(tmp_path)).breaks


def test_the_chain_covers_bytes_between_the_chunks(tmp_path):
    def edit(data, chunks):
        data[chunks[5].end + PREFIX.size] ^= 1  # an index

    change(written(tmp_path), edit)
    assert len(verify(Recording.open(tmp_path)).breaks) == 1


def test_a_chunk_after_the_seal_is_found(tmp_path):
    def edit(data, chunks):
        end = data.index(b"\x0f\x04" + bytes(7), chunks[-1].end)  # the end of the data
        return data[:end] + repacked(data, chunks[4], b"{", b"{") + data[end:]

    change(written(tmp_path), edit)
    assert "after the seal" in str(verify(Recording.open(tmp_path)).breaks[-1])


def test_a_truncated_file_has_no_seal(tmp_path):
    change(written(tmp_path), lambda data, chunks: data[: chunks[9].begin])
    chain = verify(Recording.open(tmp_path, partial=True))
    assert (chain.breaks, chain.unsealed) == ((), (tmp_path / part_name(1),))
    assert chain.links == 8


@pytest.mark.parametrize("part", [1, 2])
def test_a_part_of_another_recording_is_found(tmp_path, part):
    mine, other = written(tmp_path / "mine", parts=3), written(tmp_path / "other", parts=3, ticks=168)
    (other / part_name(part)).replace(mine / part_name(part))
    breaks = verify(Recording.open(mine)).breaks
    assert any("does not continue the previous part" in str(found) for found in breaks)


@pytest.mark.parametrize(
    ("part", "text"), [(3, "part 3 is missing; this part is not the last one"), (1, "part 1 is missing")]
)
def test_a_part_removed_at_the_end_or_the_beginning_is_found(tmp_path, part, text):
    (written(tmp_path, parts=3) / part_name(part)).unlink()
    (found,) = verify(Recording.open(tmp_path)).breaks
    assert text in str(found)
    assert found.time == pytest.approx(0.012 * 319 if part == 3 else 0.0, abs=0.001)
    for file in tmp_path.iterdir():  # a single file may be verified alone
        assert verify(Recording.open(file)).breaks == ()


def test_a_part_cannot_be_changed_into_the_last_one(tmp_path):
    (written(tmp_path, parts=3) / part_name(3)).unlink()
    change(tmp_path, lambda data, chunks: data.replace(b"false", b"truth"), part=2)
    (found,) = verify(Recording.open(tmp_path)).breaks
    assert "its hash differs" in str(found)


@pytest.mark.parametrize("last", [True, None])
def test_a_recording_of_an_earlier_version_does_not_state_its_end(tmp_path, monkeypatch, last):
    finish = ChainWriter.finish
    monkeypatch.setattr(ChainWriter, "finish", lambda self, **_: finish(self, last=last))
    chain = verify(Recording.open(written(tmp_path, parts=2)))
    assert (chain.breaks, chain.parts, chain.last) == ((), (1, 2), last)


def test_a_recording_without_a_chain_is_recognised(tmp_path):
    import mcap.writer

    file = written(tmp_path) / part_name(1)
    recording = Recording.open(tmp_path)
    messages = [m for m in recording.messages() if m[0] != "/chain"]
    with file.open("wb") as stream:
        writer = mcap.writer.Writer(stream)
        writer.start(profile="armgate")
        channels = {}
        for topic, time, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            writer.add_message(channels[topic], recording.header.origin_ns + round(time * 1e9), data, 0)
        writer.finish()
    assert not verify(Recording.open(tmp_path)).present

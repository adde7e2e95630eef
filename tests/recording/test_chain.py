"""Hash chain of a recording: what was changed, removed or inserted is found, with its place."""

import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk

from armgate.recording import Recording, Sink, part_name
from armgate.recording.chain import ChainWriter
from armgate.recording.scan import PREFIX, scan
from armgate.recording.verify import verify
from support import records


def written(folder: Path, parts=1, ticks=160, signer=None):
    """A recording of some parts, of which each names the one before."""
    folder.mkdir(exist_ok=True)
    previous = ""
    for part in range(1, parts + 1):
        stream = records.File(folder / part_name(part))
        sink = Sink(stream, records.header(part, previous=previous), signer)
        for k in range(ticks * (part - 1), ticks * part):
            for time, item in records.tick_items(k):
                sink.put(item, time)
            if k % 8 == 7:
                sink.flush()
        previous = sink.close(last=part == parts).digest.hex()
        stream.file.close()
    return folder


def change(folder, edit, part=1):
    """Edit the bytes of a file."""
    file = folder / part_name(part)
    chunks, data = scan(file).chunks, bytearray(file.read_bytes())
    file.write_bytes(edit(data, chunks) or data)
    return chunks


def repacked(data, place, old, new):
    """A chunk with other messages, whole in itself."""
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
    assert (
        chain.links == 3 * 21
    )  # 20 chunks behind the header's, of which the first begins with a link, and a seal


def test_what_is_written_in_a_long_chunk_is_in_the_chain(tmp_path):
    stream = records.File(tmp_path / part_name(1))
    sink = Sink(stream, records.header())
    for k in range(6000):  # more than a chunk holds
        for time, item in records.tick_items(k):
            sink.put(item, time)
    sink.close()
    stream.file.close()
    assert len(scan(tmp_path / part_name(1)).chunks) > 3
    assert verify(Recording.open(tmp_path)).breaks == ()

    def edit(data, chunks):
        data[chunks[2].begin : chunks[2].end] = repacked(data, chunks[2], b'"owner":"x"', b'"owner":"y"')

    change(tmp_path, edit)
    assert len(verify(Recording.open(tmp_path)).breaks) == 1


@pytest.mark.parametrize("k", [0, 1, 7, 20])
def test_a_changed_message_is_found_in_its_chunk_and_the_rest_holds(tmp_path, k):
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


def test_what_is_between_the_chunks_is_in_the_chain(tmp_path):
    def edit(data, chunks):
        data[chunks[5].end + PREFIX.size] ^= 1  # an index

    change(written(tmp_path), edit)
    assert len(verify(Recording.open(tmp_path)).breaks) == 1


def test_a_chunk_behind_the_seal_is_found(tmp_path):
    def edit(data, chunks):
        end = data.index(b"\x0f\x04" + bytes(7), chunks[-1].end)  # the end of the data
        return data[:end] + repacked(data, chunks[4], b"{", b"{") + data[end:]

    change(written(tmp_path), edit)
    assert "behind the seal" in str(verify(Recording.open(tmp_path)).breaks[-1])


def test_a_file_that_was_cut_is_not_sealed(tmp_path):
    change(written(tmp_path), lambda data, chunks: data[: chunks[9].begin])
    chain = verify(Recording.open(tmp_path, partial=True))
    assert (chain.breaks, chain.unsealed) == ((), (tmp_path / part_name(1),))
    assert chain.links == 8


@pytest.mark.parametrize("part", [1, 2])
def test_a_part_of_another_recording_is_found(tmp_path, part):
    mine, other = written(tmp_path / "mine", parts=3), written(tmp_path / "other", parts=3, ticks=168)
    (other / part_name(part)).replace(mine / part_name(part))
    breaks = verify(Recording.open(mine)).breaks
    assert any("follows another part" in str(found) for found in breaks)


@pytest.mark.parametrize(("part", "text"), [(3, "part 3 followed, and is missing"), (1, "part 1 is missing")])
def test_a_part_removed_at_the_end_or_the_beginning_is_found(tmp_path, part, text):
    (written(tmp_path, parts=3) / part_name(part)).unlink()
    (found,) = verify(Recording.open(tmp_path)).breaks
    assert text in str(found)
    assert found.time == pytest.approx(0.012 * 319 if part == 3 else 0.0, abs=0.001)
    for file in tmp_path.iterdir():  # one file that is named is not the folder
        assert verify(Recording.open(file)).breaks == ()


def test_a_part_that_is_followed_cannot_be_made_the_last_one(tmp_path):
    (written(tmp_path, parts=3) / part_name(3)).unlink()
    change(tmp_path, lambda data, chunks: data.replace(b"false", b"truth"), part=2)
    (found,) = verify(Recording.open(tmp_path)).breaks
    assert "its hash is another" in str(found)


@pytest.mark.parametrize("last", [True, None])
def test_a_recording_that_does_not_state_its_end_is_distinguished(tmp_path, monkeypatch, last):
    finish = ChainWriter.finish
    monkeypatch.setattr(ChainWriter, "finish", lambda self, **_: finish(self, last=last))
    chain = verify(Recording.open(written(tmp_path, parts=2)))
    assert (chain.breaks, chain.parts, chain.last) == ((), (1, 2), last)


def test_a_recording_without_a_chain_has_none(tmp_path):
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

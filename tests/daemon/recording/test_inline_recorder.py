"""The recorder of a lock-step run: everything is written between two turns of the event loop."""

import asyncio
import errno
import os

from armgate.daemon.recording.inline_recorder import InlineRecorder
from armgate.recorder.record_file import DiskCalls, RecordFile
from armgate.recording import LogLine, Recording
from support import records
from support.clients import until


def feed(recorder, ticks):
    for k in ticks:
        _, step = records.tick_items(k)[0]
        recorder.tap(step.event, step.outputs)


def ticks_of(folder, **how):
    return [step.event.tick for _, step in Recording.open(folder, **how).steps()]


async def test_records_are_written_in_order_at_the_next_turn_and_the_file_is_closed(tmp_path):
    recorder = InlineRecorder(tmp_path / "run")
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(100))
    assert recorder.depth == 100
    await asyncio.sleep(0)
    assert recorder.depth == 0
    feed(recorder, range(100, 200))
    recorder.log({"time": 1.7e9, "level": "info", "event": "hello", "name": "x"})
    recorder.close()
    *steps, line = [item for _, item in Recording.open(tmp_path / "run").items()]
    assert [step.event.tick for step in steps] == list(range(200))
    assert line == LogLine(1.7e9, "info", "hello", {"name": "x"})
    assert recorder.trouble is None


async def test_no_record_of_one_turn_is_lost(tmp_path):
    recorder = InlineRecorder(tmp_path, limit=10)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(200))
    assert recorder.depth < 10
    recorder.close()
    assert recorder.lost == 0
    assert ticks_of(tmp_path) == list(range(200))


async def test_the_last_record_is_flushed_even_if_no_other_follows(tmp_path):
    recorder = InlineRecorder(tmp_path, flush=0.0)
    recorder.begin(records.header(), lambda: 0.5)
    size = (tmp_path / "recording-0001.mcap").stat().st_size
    feed(recorder, range(3))
    await until(lambda: (tmp_path / "recording-0001.mcap").stat().st_size > size)
    assert ticks_of(tmp_path, partial=True) == [0, 1, 2]
    recorder.close()


async def test_files_rotate_by_size_and_each_is_complete(tmp_path):
    recorder = InlineRecorder(tmp_path, rotate=20_000, flush=0.0)
    recorder.begin(records.header(), lambda: 0.5)
    for k in range(400):
        feed(recorder, [k])
        await asyncio.sleep(0)
    recorder.close()
    assert len(Recording.open(tmp_path).parts) > 2
    assert ticks_of(tmp_path) == list(range(400))


class Full(RecordFile):
    """A disk that is full after 12 kB."""

    @classmethod
    def create(cls, path, header, _signer):
        left = [12_000]

        def write(descriptor, data):
            if not left[0]:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            piece = data[: min(left[0], 1000)]
            left[0] -= len(piece)
            return os.write(descriptor, piece)

        return cls(path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), header, DiskCalls(write))


async def test_a_full_disk_ends_the_recording_and_later_records_are_counted(tmp_path):
    recorder = InlineRecorder(tmp_path, create=Full.create, flush=0.0)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(3000))
    await until(lambda: recorder.trouble is not None)
    assert os.strerror(errno.ENOSPC) in recorder.trouble
    feed(recorder, range(7))
    assert recorder.lost == 7
    recorder.close()

"""The recorder: delays no tick, marks lost records, and leaves readable files after every failure."""

import errno
import os
import threading

import pytest

from armgate.audit.recover import recover_recording
from armgate.daemon.recording.inline_recorder import InlineRecorder
from armgate.daemon.recording.recorder import Recorder
from armgate.daemon.recording.worker import ThreadWorker
from armgate.recorder.record_file import DiskCalls, RecordFile
from armgate.recording import Gap, LogLine, Recording, Step
from armgate.recording.verify import verify
from support import records


def feed(recorder, ticks):
    for k in ticks:
        _, step = records.tick_items(k)[0]
        recorder.tap(step.event, step.outputs)


def test_records_are_written_in_order_and_the_file_is_closed(tmp_path):
    recorder = Recorder(tmp_path / "run")
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(500))
    recorder.log({"time": 1.7e9, "level": "info", "event": "hello", "name": "x"})
    recorder.close()
    recording = Recording.open(tmp_path / "run")
    *steps, line = [item for _, item in recording.items()]
    assert [step.event.tick for step in steps] == list(range(500))
    assert line == LogLine(1.7e9, "info", "hello", {"name": "x"})
    assert recorder.trouble is None
    assert recorder.lost == 0


def test_files_rotate_by_size_and_each_is_complete(tmp_path):
    recorder = Recorder(tmp_path, rotate=20_000, flush=0.0)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(400))
    recorder.close()
    recording = Recording.open(tmp_path)
    assert len(recording.parts) > 3
    assert [step.event.tick for _, step in recording.steps()] == list(range(400))
    assert [part.header.part for part in recording.parts] == list(range(1, len(recording.parts) + 1))
    assert [verify(Recording.open(part.file)).last for part in recording.parts][-2:] == [False, True]
    recording.parts[-1].file.unlink()
    (missing,) = verify(Recording.open(tmp_path)).breaks
    assert f"part {len(recording.parts)} is missing" in str(missing)


class Clock:
    """Clock of the writer thread: it advances while the thread waits, then feeds the records that are due."""

    def __init__(self, due):
        self.time, self.due, self.fed = 0.0, due, {}
        self.feed, self.over = None, threading.Event()

    def pause(self, seconds):
        self.time += max(seconds, 0.001)  # (writing takes its time, too)
        while self.due and self.due[0] <= self.time:
            self.fed[len(self.fed)] = self.due.pop(0)
            self.feed(len(self.fed) - 1)
        if not self.due:
            self.over.set()


@pytest.mark.parametrize("period", [0.004, 0.012, 0.15, 1.0])
def test_a_record_is_flushed_within_a_fifth_of_a_second(tmp_path, period):
    """If the daemon is killed at any moment, at most the last 0.2 s of the run are lost."""
    clock = Clock([period * k for k in range(round(3.0 / period))])
    flushed = {}

    class Timed(RecordFile):
        put_steps = 0

        def put(self, item, at):
            super().put(item, at)
            self.put_steps += 1

        def flush(self):
            super().flush()
            for k in range(len(flushed), self.put_steps):
                flushed[k] = clock.time

    recorder = Recorder(
        tmp_path,
        create=Timed.create,
        clock=lambda: clock.time,
        worker=lambda pauses: ThreadWorker(pauses, clock.pause),
    )
    clock.feed = lambda k: feed(recorder, [k])
    recorder.begin(records.header(), lambda: clock.time)
    assert clock.over.wait(20)
    recorder.close()
    assert len(flushed) == len(clock.fed) > 2
    assert max(flushed[k] - clock.fed[k] for k in clock.fed) <= 0.2


class Blocked(RecordFile):
    """A disk on which every write waits until ``gate`` is set."""

    gate = threading.Event()
    reached = threading.Event()

    def put(self, item, at):
        self.reached.set()
        assert self.gate.wait(20)
        super().put(item, at)


def test_a_slow_disk_delays_no_caller_and_lost_records_are_marked(tmp_path):
    Blocked.gate.clear()
    Blocked.reached.clear()
    recorder = Recorder(tmp_path, limit=100, create=Blocked.create)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, [0])
    assert Blocked.reached.wait(20)
    feed(recorder, range(1, 301))  # returns, though nothing is written
    assert recorder.lost == 200
    assert "200 records were lost" in recorder.trouble
    Blocked.gate.set()
    while recorder.depth:
        pass
    feed(recorder, [301])
    recorder.close()
    items = [item for _, item in Recording.open(tmp_path).items()]
    assert [item.event.tick for item in items if isinstance(item, Step)] == [*range(101), 301]
    assert items[-2] == Gap(200, 200)


def full_after(limit):
    """A disk with space for some bytes, written in pieces."""
    left = [limit]

    def write(descriptor, data):
        if not left[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        piece = data[: min(left[0], 1000)]
        left[0] -= len(piece)
        return os.write(descriptor, piece)

    class Full(RecordFile):
        @classmethod
        def create(cls, path, header, _signer):
            return cls(
                path, os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), header, DiskCalls(write)
            )

    return Full.create


@pytest.mark.parametrize("room", [12_000, 14_000, 20_000, 33_333])
def test_a_full_disk_ends_the_recording_with_its_last_complete_chunk(tmp_path, room):
    recorder = Recorder(tmp_path, create=full_after(room), flush=0.0)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(3000))
    recorder.close()
    assert os.strerror(errno.ENOSPC) in recorder.trouble
    assert "recording-0001.mcap" in recorder.trouble
    (one,) = recover_recording(tmp_path)
    assert (one.action, one.result.dropped, one.result.lost) == ("recovered", 0, 0)
    ticks = [step.event.tick for _, step in Recording.open(tmp_path).steps()]
    assert ticks == list(range(len(ticks)))


def test_a_disk_without_space_for_the_header_is_an_error_at_once(tmp_path):
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
        Recorder(tmp_path, create=full_after(50)).begin(records.header(), lambda: 0.5)


@pytest.mark.parametrize("at", ["index", "last chunk", "fsync"])
@pytest.mark.parametrize("kind", [Recorder, InlineRecorder])
async def test_a_disk_that_is_full_only_at_the_end_is_reported_and_the_file_closed(tmp_path, at, kind):
    full, full_at_sync, descriptors = [], [], []

    def write(descriptor, data):
        if full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.write(descriptor, data)

    def sync(descriptor):
        if full_at_sync:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        os.fsync(descriptor)

    class Full(RecordFile):
        @classmethod
        def create(cls, path, header, _signer):
            descriptors.append(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644))
            return cls(path, descriptors[0], header, DiskCalls(write, sync))

        def close(self, **how):
            if at == "index":
                self.flush()
            if at == "fsync":
                full_at_sync.append(True)
            else:
                full.append(True)
            return super().close(**how)

    recorder = kind(tmp_path, create=Full.create, flush=10.0)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, range(50))
    recorder.close()
    assert recorder.ended_early
    assert recorder.seal is None
    assert os.strerror(errno.ENOSPC) in recorder.trouble
    with pytest.raises(OSError, match=os.strerror(errno.EBADF)):
        os.fstat(descriptors[0])
    (one,) = recover_recording(tmp_path)
    ticks = [step.event.tick for _, step in Recording.open(tmp_path).steps()]
    assert ticks == list(range(0 if at == "last chunk" else 50))
    assert one.action == "recovered"


def test_a_disk_that_does_not_answer_at_the_end_is_reported(tmp_path):
    Blocked.gate.clear()
    recorder = Recorder(tmp_path, create=Blocked.create)
    recorder.begin(records.header(), lambda: 0.5)
    feed(recorder, [0])
    recorder.close(timeout=0.05)
    assert "not written within 0.05 s" in recorder.trouble
    assert recorder.ended_early
    Blocked.gate.set()

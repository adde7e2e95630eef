"""The log: one JSON object per line, written without delaying its callers."""

import io
import json
import threading

from armgate.links.log import Log


def test_a_line_is_a_json_object_with_time_level_event_and_fields():
    stream = io.StringIO()
    log = Log(stream, now=lambda: 12.5)
    log.info("welcome", name="wave")
    log.warning("stopped", stop=1)
    log.error("failed", error=ValueError("x"))
    log.close()
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert lines[0] == {"time": 12.5, "level": "info", "event": "welcome", "name": "wave"}
    assert [line["level"] for line in lines] == ["info", "warning", "error"]
    assert lines[2]["error"] == "x"


class Stuck(io.StringIO):
    """A pipe that is never read."""

    def __init__(self):
        super().__init__()
        self.free = threading.Event()

    def write(self, text):
        self.free.wait(10)
        return super().write(text)


def test_an_unread_log_delays_no_caller_and_the_gap_is_reported():
    stream = Stuck()
    log = Log(stream, now=lambda: 0.0)
    for number in range(10_000):
        log.info("tick", number=number)
    stream.free.set()
    while not log._lines.empty():
        threading.Event().wait(0.001)
    log.info("after")
    log.close()
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert lines[-1]["dropped_before"] == 10_000 - (len(lines) - 1)
    assert [line["number"] for line in lines[:-1]] == list(range(len(lines) - 1))


def test_a_closed_stream_ends_the_log_quietly():
    stream = io.StringIO()
    log = Log(stream)
    stream.close()
    log.info("x")
    log.close()
    assert not log._thread.is_alive()

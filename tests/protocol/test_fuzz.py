"""Short run of the fuzzer, and its ability to find planted defects."""

import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from armgate.protocol import INBOUND_LIMIT, Connection, Side, codec
from armgate.protocol.framing import HEADER, FrameDecoder
from tools.fuzz.__main__ import main
from tools.fuzz.blind import search
from tools.fuzz.corpus import FRESH_SERVER, corpus
from tools.fuzz.target import ROLES, BrokenError, check

ROOT = Path(__file__).parents[2]


def test_every_vector_passes_the_check():
    assert len(corpus()) > 500
    assert {data[0] for data in corpus()} == set(range(len(ROLES)))
    check_all()
    check(b"")


def test_a_blind_search_finds_nothing():
    assert search(300) is None


def test_the_command_runs_both_kinds_of_search(capsys, monkeypatch):
    done = subprocess.run(
        [sys.executable, "-m", "tools.fuzz", "300"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["50"]) == 0
    assert "50 runs, nothing found" in capsys.readouterr().out
    assert main(["many"]) == 2
    assert main(["1", "2"]) == 2


def test_a_broken_reader_makes_the_command_fail(capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(codec, "_unique", lambda pairs: {}[pairs])
    assert main(["50"]) == 1
    assert "TypeError" in capsys.readouterr().err


# --- planted defects --------------------------------------------------------------------------------------


def pop_one_late(decoder):
    """Delay each payload to the next push, so that the result depends on how the stream is divided."""
    waiting = decoder.__dict__.setdefault("waiting", [])
    if len(decoder._buffer) < HEADER:
        return waiting.pop() if waiting else None
    found = ORIGINAL_POP(decoder)
    if found is not None:
        waiting.append(found)
    return None


ORIGINAL_POP = FrameDecoder.pop


DEFECTS = {
    "a result that depends on how the stream is divided": (FrameDecoder, "pop", pop_one_late),
    "a defect of the decoder": (codec, "_is_deep", lambda value: {}[type(value)]),
    "a message that changes in a round trip": (codec, "_unique", lambda pairs: dict(pairs[::-1])),
}


@pytest.mark.parametrize("defect", DEFECTS)
def test_a_planted_defect_fails_on_the_vectors(defect, monkeypatch):
    monkeypatch.setattr(*DEFECTS[defect])
    with pytest.raises(Exception):  # noqa: B017, PT011 (any exception is a finding)
        check_all()


def check_all():
    for data in corpus():
        check(data)


def test_a_buffer_beyond_the_limit_is_found(monkeypatch):
    monkeypatch.setattr(FrameDecoder, "_check", lambda decoder, length: None)
    with pytest.raises(BrokenError, match="are buffered"):
        check(FRESH_SERVER + (5000).to_bytes(4, "big") + bytes(4500))


# --- memory -----------------------------------------------------------------------------------------------


@pytest.mark.daily(2)
@pytest.mark.parametrize(
    "chunk",
    [
        pytest.param((INBOUND_LIMIT).to_bytes(4, "big") + bytes(1000), id="a frame that never ends"),
        pytest.param(b"\xff" * 4096, id="lengths beyond the limit"),
        pytest.param(bytes(4096), id="lengths of 0"),
        pytest.param(b"\x00\x00\x00\x06\xdf\xff\xff\xff\xff\xa0", id="a map with a huge declared length"),
        pytest.param(b"\x00\x00\x00\x07\x81\xa1a\xdd\xff\xff\xff", id="an incomplete array"),
    ],
)
def test_input_takes_bounded_memory(chunk):
    connection = Connection(Side.SERVER)
    connection.push(b"")
    tracemalloc.start()
    try:
        for _ in range(20_000_000 // len(chunk) // 10):
            connection.receive(chunk)
            assert connection.buffered <= INBOUND_LIMIT + HEADER
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4 * INBOUND_LIMIT

"""Frame decoder: whole streams, byte by byte, and its bounds."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armgate.protocol.framing import HEADER, FrameDecoder, FrameError, frame

LIMIT = 64
PAYLOADS = st.lists(st.binary(min_size=1, max_size=LIMIT), max_size=8)


def cut(data, sizes):
    """Yield the data in pieces of these sizes, and the rest as one piece."""
    for size in sizes:
        yield data[:size]
        data = data[size:]
    yield data


def outcome(decoder, pieces):
    """Return all payloads and the length that ended the stream, None if it was accepted."""
    found = []
    for piece in pieces:
        decoder.push(piece)
        try:
            while (payload := decoder.pop()) is not None:
                found.append(payload)
        except FrameError as error:
            return found, error.length
    return found, None


@given(PAYLOADS, st.lists(st.integers(0, 40), max_size=20))
def test_payloads_do_not_depend_on_how_the_stream_is_divided(payloads, sizes):
    decoder = FrameDecoder(LIMIT)
    stream = b"".join(map(frame, payloads))
    found = [payload for piece in cut(stream, sizes) for payload in decoder.feed(piece)]
    assert found == payloads
    assert decoder.buffered == 0


@given(st.one_of(st.binary(max_size=300), PAYLOADS.map(lambda p: b"".join(map(frame, p)) + b"\0\0\1\0junk")))
def test_garbage_gives_the_same_result_byte_by_byte_and_takes_bounded_memory(stream):
    whole = outcome(FrameDecoder(LIMIT), [stream])
    decoder = FrameDecoder(LIMIT)
    found = []
    error = None
    for byte in stream:
        try:
            found += decoder.feed(bytes([byte]))
        except FrameError as raised:
            error = raised.length
        assert decoder.buffered < HEADER + LIMIT
    assert (found, error) == whole


@pytest.mark.parametrize("length", [LIMIT + 1, 2**31, 2**32 - 1])
def test_a_length_beyond_the_limit_is_refused_when_its_header_is_complete(length):
    decoder = FrameDecoder(LIMIT)
    header = length.to_bytes(HEADER, "big")
    assert decoder.feed(header[:3]) == []
    with pytest.raises(FrameError, match=f"{length} bytes; at most 64") as caught:
        decoder.feed(header[3:])
    assert (caught.value.length, caught.value.limit) == (length, LIMIT)


def test_length_zero_is_an_error():
    with pytest.raises(FrameError, match="a frame of length 0") as caught:
        FrameDecoder(LIMIT).feed(bytes(HEADER))
    assert caught.value.length == 0


def test_after_an_error_the_decoder_discards_all_input():
    decoder = FrameDecoder(LIMIT)
    for _ in range(3):
        with pytest.raises(FrameError):
            decoder.feed(bytes(HEADER) + b"x" * 1000 + frame(b"good"))
        assert decoder.buffered == 0


def test_the_limit_may_change_between_two_frames():
    decoder = FrameDecoder(4)
    decoder.push(frame(b"1234") + frame(b"12345"))
    assert decoder.pop() == b"1234"
    decoder.limit = 5
    assert decoder.pop() == b"12345"


def test_no_byte_is_searched_twice_while_frames_are_popped():
    decoder = FrameDecoder(1000)
    decoder.push(frame(b"x" * 500) * 500)
    decoder._buffer = Searched(decoder._buffer)
    while decoder.pop() is not None:
        assert not decoder.may_hold(b"word")
    assert decoder._buffer.passed < 2 * 500 * 504


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_word_that_arrives_in_pieces_is_found(cut):
    decoder, data = FrameDecoder(1000), frame(b"12word34")
    decoder.push(frame(b"x") + data[:cut])
    assert not decoder.may_hold(b"word") or cut >= 10
    decoder.push(data[cut:])
    decoder.pop()
    assert decoder.may_hold(b"word")


class Searched(bytearray):
    """Buffer that counts the bytes that searches pass."""

    passed = 0

    def find(self, word, begin):
        at = super().find(word, begin)
        self.passed += (len(self) if at < 0 else at) - begin
        return at

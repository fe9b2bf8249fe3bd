import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.latch_board_frames import crc_bit_by_bit, cut, framed
from traverse.protocol.latch_board.framing import (
    MAX_BODY,
    MAX_SEGMENT,
    FrameSplitter,
    encode_frame,
)

bodies = st.binary(min_size=1, max_size=MAX_BODY)


def fed(chunks: list[bytes]) -> tuple[list[bytes], dict[str, int], int, int]:
    splitter = FrameSplitter()
    bodies = [body for chunk in chunks for body in splitter.feed(chunk)]
    return bodies, dict(splitter.faults), splitter.accepted, splitter.pending


def test_crc_is_that_of_the_specification():
    assert crc_bit_by_bit(b"123456789") == 0x29B1


def test_the_worked_example_of_the_specification():
    wire = bytes.fromhex("02 01 02 2A 03 59 1B 00")
    assert encode_frame(bytes.fromhex("01 00 2A 00")) == wire
    assert FrameSplitter().feed(wire) == [bytes.fromhex("01 00 2A 00")]


@given(bodies)
def test_a_frame_is_what_an_independent_encoder_makes(body):
    assert encode_frame(body) == framed(body)
    assert FrameSplitter().feed(framed(body)) == [body]


@pytest.mark.parametrize("size", [0, MAX_BODY + 1])
def test_a_body_of_impossible_size_is_refused(size):
    with pytest.raises(ValueError, match="1 to 250"):
        encode_frame(bytes(size))


@given(st.lists(bodies, max_size=5), st.lists(st.integers(0, 5000), max_size=8))
def test_the_cutting_into_reads_does_not_matter(all_bodies, cuts):
    data = b"".join(map(framed, all_bodies))
    assert fed(cut(data, cuts)) == fed([data])
    assert fed([data])[0] == all_bodies


@given(
    st.lists(st.one_of(bodies.map(framed), st.binary(max_size=600)), max_size=6),
    st.lists(st.integers(0, 5000), max_size=8),
)
def test_garbage_gives_the_same_result_however_it_is_cut(pieces, cuts):
    data = b"".join(pieces)
    assert fed(cut(data, cuts)) == fed([data])
    assert fed([bytes([byte]) for byte in data]) == fed([data])


@given(bodies)
def test_every_prefix_is_incomplete(body):
    wire = framed(body)
    for size in range(len(wire)):
        bodies, faults, _, _ = fed([wire[:size]])
        assert not bodies
        assert not faults


@given(bodies, bodies, st.binary(max_size=1000))
def test_garbage_costs_at_most_the_frame_it_touches(first, second, garbage):
    splitter = FrameSplitter()
    assert splitter.feed(framed(first)) == [first]
    splitter.feed(garbage + b"\0")
    assert splitter.feed(framed(second)) == [second]


@given(bodies, st.integers(0, 10_000), st.integers(1, 255))
def test_one_corrupted_byte_never_gives_a_wrong_body(body, place, flip):
    wire = bytearray(framed(body))
    place %= len(wire) - 1  # the delimiter stays: else two frames are touched
    wire[place] ^= flip
    splitter = FrameSplitter()
    bodies = splitter.feed(bytes(wire))
    # A new 00 cuts the frame in two; neither part passes the CRC with the same body.
    assert body not in bodies
    assert splitter.feed(framed(b"next")) == [b"next"]


def test_a_segment_without_end_is_counted_once_and_not_kept():
    splitter = FrameSplitter()
    for _ in range(1000):
        splitter.feed(b"\x55" * 1000)
        assert splitter.pending <= MAX_SEGMENT
    assert splitter.faults == {"too_long": 1}
    assert splitter.feed(b"\0" + framed(b"next")) == [b"next"]
    assert splitter.faults == {"too_long": 1}

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol import latch_board_frames as golden
from tests.protocol.latch_board_frames import cut, frame, framed
from traverse.protocol.latch_board import messages as wire


def plain(message: wire.Message) -> list[tuple]:
    if not isinstance(message, wire.SampleBlock):
        return [(message,)]
    columns = (message.seq, message.ticks, message.inputs, message.counts)
    return [
        (message.request, *(c[i].tolist() for c in columns), message.status[i].tolist())
        for i in range(len(message.seq))
    ]


def decoded(chunks: list[bytes]) -> tuple[list[tuple], dict[str, int]]:
    decoder = wire.Decoder()
    rows = [r for chunk in chunks for m in decoder.feed(chunk) for r in plain(m)]
    return rows, dict(decoder.faults)


def sample(seq: int, request: int = 1, n: int = 7, cause: int = 0) -> bytes:
    head = struct.pack("<BBBBII", 0x83, cause, request, 0, seq, 100 * seq % 2**32)
    return framed(head + struct.pack(f"<{n}I", *range(n)) + bytes(n))


def test_requests_are_the_bytes_of_the_specification():
    assert wire.hello_request(1, wire.FORGET_EDGES) == frame(golden.HELLO_REQUEST)
    assert wire.configure_request(2, 3, 1000, 5000, 5000) == frame(golden.CONFIGURE)
    assert wire.start_request(3, 1_000_000) == frame(golden.START_1_KHZ)
    assert wire.stop_request(4) == frame(golden.STOP)
    assert wire.latch_request(5) == frame(golden.LATCH)
    assert wire.edge_ack(258) == frame(golden.EDGE_ACK_258)


def test_what_the_board_sends_is_read_as_specified():
    hello, reply, block, edge, temperatures, alarm, heartbeat = wire.Decoder().feed(
        b"".join(map(frame, golden.FROM_BOARD))
    )
    assert hello == wire.Hello(
        request=1,
        version=(1, 0),
        board_id=bytes.fromhex("54 52 41 56 45 52 53 45 00 00 00 07"),
        firmware=(1, 2, 3),
        n_inputs=2,
        n_temperatures=1,
        tick_rate_hz=1_000_000,
        max_rate_hz=10_000.0,
        boot_id=0xDEADBEEF,
        channels=(wire.Channel(23, 8_388_608), wire.Channel(32, 1_048_576)),
    )
    assert reply == wire.Reply(wire.START, 3, 0, 1_000_000)
    assert isinstance(block, wire.SampleBlock)
    assert plain(block) == [(3, 42, 10_000, 1, [197_121, 8_388_607], [0, 2])]
    counts = (197_121, 8_388_607)
    assert edge == wire.Edge(0, 1, 1, 7, 10_001, counts, (0, 0))
    assert temperatures == wire.Temperatures(10_001, (23.0, None))
    assert alarm == wire.Alarm(1, True, 1, 0, 10_002, 350)
    assert heartbeat == wire.Heartbeat(True, 0, 0, 10_003, 43, 8, 0, 0)


def test_a_modulus_of_zero_is_the_whole_width_of_the_word():
    hello = struct.pack("<BBBB12s3sBBBIII", 0x81, 1, 1, 0, b"", b"", 1, 0, 0, 1, 1, 1)
    (message,) = wire.Decoder().feed(framed(hello + struct.pack("<BI", 32, 0)))
    assert isinstance(message, wire.Hello)
    assert message.channels == (wire.Channel(32, 2**32),)


def test_samples_in_one_read_become_one_block():
    (block,) = wire.Decoder().feed(b"".join(sample(k) for k in range(100)))
    assert isinstance(block, wire.SampleBlock)
    assert np.array_equal(block.seq, np.arange(100))
    assert block.counts.shape == (100, 7)


def test_a_latched_sample_is_no_timed_one():
    first, latched, second = wire.Decoder().feed(
        sample(0) + sample(0, request=9, cause=1) + sample(1)
    )
    assert isinstance(latched, wire.Latched)
    assert latched.request == 9
    assert latched.counts == tuple(range(7))
    assert len(first.seq) == len(second.seq) == 1


def test_a_new_stream_begins_a_new_block():
    blocks = wire.Decoder().feed(sample(5, request=1) + sample(0, request=2))
    assert [block.request for block in blocks] == [1, 2]


@pytest.mark.parametrize("text", golden.FROM_BOARD)
def test_a_wrong_length_is_counted_and_dropped(text):
    stuffed = frame(text)
    body = unstuffed(stuffed)
    for wrong in (body[:-1], body + b"\1"):
        assert decoded([framed(wrong)]) == ([], {"bad_length": 1})


def unstuffed(stuffed: bytes) -> bytes:
    out, place = bytearray(), 0
    while stuffed[place]:
        out += stuffed[place + 1 : place + stuffed[place]] + b"\0"
        place += stuffed[place]
    return bytes(out[:-3])


def test_an_unknown_type_is_counted_and_dropped():
    assert decoded([framed(b"\x99\1\2")]) == ([], {"unknown_type": 1})


@given(
    st.lists(
        st.one_of(
            st.sampled_from([frame(text) for text in golden.FROM_BOARD]),
            st.integers(0, 2**32 - 1).map(sample),
            st.integers(1, 255).map(lambda r: sample(3, request=r, n=2)),
            st.binary(max_size=300),
        ),
        max_size=12,
    ),
    st.lists(st.integers(0, 5000), max_size=10),
)
def test_the_cutting_into_reads_changes_nothing(pieces, cuts):
    data = b"".join(pieces)
    assert decoded(cut(data, cuts)) == decoded([data])


@given(st.binary(min_size=1, max_size=250))
def test_any_valid_frame_is_read_or_counted_but_never_raises(body):
    decoder = wire.Decoder()
    messages = decoder.feed(framed(body))
    assert len(messages) + decoder.faults.total() == 1

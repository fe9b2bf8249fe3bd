"""Golden bytes are copied by hand from section 6 of docs/serial-protocol.md."""

import numpy as np
import pytest

from traverse.simulator.devices.latch_board import wire

COUNTS = np.array([197121, 8388607], dtype=np.uint32)
IDENTITY = wire.Identity(
    board_id=bytes.fromhex("54 52 41 56 45 52 53 45 00 00 00 07"),
    firmware=(1, 2, 3),
    n_inputs=2,
    n_temperatures=1,
    tick_rate_hz=1_000_000,
    max_rate_millihz=10_000_000,
    boot_id=0xDEADBEEF,
    bits=(23, 32),
    moduli=(8388608, 1048576),
)


def hexes(data: bytes) -> str:
    return data.hex(" ").upper()


def test_example_of_the_framing_section():
    assert hexes(wire.frame(bytes.fromhex("01002A00"))) == "02 01 02 2A 03 59 1B 00"


def test_hello():
    assert hexes(wire.hello(1, IDENTITY)) == (
        "04 81 01 01 09 54 52 41 56 45 52 53 45 01 01 0B 07 01 02 03 02 02 01 40 42 0F "
        "04 80 96 98 06 EF BE AD DE 17 01 02 80 02 20 01 02 10 03 3E 5A 00"
    )


def test_reply():
    expected = "04 82 03 03 04 40 42 0F 03 14 58 00"
    assert hexes(wire.reply(wire.START, 3, 0, 1_000_000)) == expected


def test_sample():
    data = wire.samples(
        0,
        3,
        1,
        seqs=np.array([42], dtype=np.uint32),
        ticks=np.array([10000], dtype=np.uint32),
        counts=COUNTS[None, :],
        status=np.array([[0, 2]], dtype=np.uint8),
    )
    assert [hexes(frame) for frame in data] == [
        "02 83 04 03 01 2A 01 01 03 10 27 01 04 01 02 03 04 FF FF 7F 01 04 02 79 1F 00"
    ]


def test_edge():
    data = wire.edge(
        0, 1, 1, seq=7, ticks=10001, counts=COUNTS, status=np.zeros(2, dtype=np.uint8)
    )
    assert hexes(data) == (
        "02 84 04 01 01 07 01 01 03 11 27 01 04 01 02 03 04 FF FF 7F 01 01 03 33 3A 00"
    )


def test_temperatures():
    data = wire.temperatures(10001, [23.0, None])
    assert hexes(data) == "04 85 11 27 01 03 FC 08 04 80 8F 35 00"


def test_alarm():
    data = wire.alarm(1, 1, 1, seq=0, ticks=10002, value=350)
    assert hexes(data) == (
        "05 86 01 01 01 01 01 01 01 03 12 27 01 03 5E 01 01 03 E0 0D 00"
    )


def test_heartbeat():
    data = wire.heartbeat(
        1,
        0,
        10003,
        edges_back=0,
        next_sample_seq=43,
        next_edge_seq=8,
        tx_dropped=0,
        rx_rejected=0,
    )
    assert hexes(data) == (
        "03 87 01 01 03 13 27 01 02 2B 01 01 02 08 01 01 01 01 01 01 01 01 01 01 "
        "03 05 E6 00"
    )


@pytest.mark.parametrize(
    ("on_the_wire", "body"),
    [
        ("07 01 01 01 01 54 E6 00", "01 01 01 01"),
        (
            "0A 02 02 03 E8 03 88 13 88 13 01 03 31 40 00",
            "02 02 03 E8 03 88 13 88 13 00 00",
        ),
        ("06 03 03 40 42 0F 03 4D 23 00", "03 03 40 42 0F 00"),
        ("05 04 04 4F 91 00", "04 04"),
        ("05 05 05 5F B2 00", "05 05"),
        ("04 06 02 01 01 03 D1 06 00", "06 02 01 00 00"),
    ],
)
def test_requests_are_read_in_any_chunks(on_the_wire, body):
    data = b"\0" + bytes.fromhex(on_the_wire) + b"\0"
    for size in (1, 3, len(data)):
        segments = wire.Segments()
        bodies = [
            wire.body_of(segment)
            for start in range(0, len(data), size)
            for segment in segments.feed(data[start : start + size])
        ]
        assert bodies == [bytes.fromhex(body)]


@pytest.mark.parametrize("flipped", range(8 * 7))
def test_every_single_bit_error_is_noticed(flipped):
    data = bytearray.fromhex("07 01 01 01 01 54 E6 00")
    data[flipped // 8] ^= 1 << flipped % 8
    segments = list(wire.Segments().feed(bytes(data)))
    assert all(wire.body_of(segment) is None for segment in segments)


def test_a_segment_that_is_too_long_is_dropped_and_counted_once():
    segments = wire.Segments()
    assert list(segments.feed(b"\x01" * 1000)) == []
    good = bytes.fromhex("05 04 04 4F 91 00")
    assert list(segments.feed(b"\x01" * 1000 + b"\0" + good)) == [good[:-1]]
    assert segments.n_too_long == 1

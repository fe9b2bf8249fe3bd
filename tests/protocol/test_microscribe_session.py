import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.latch_board_frames import cut
from traverse.protocol.microscribe import session as wire
from traverse.protocol.microscribe.packets import (
    Framing,
    Packet,
    PacketDecoder,
    packet_request,
    packet_size,
)

# 90 degrees, 10.250 in: the two examples of the specification.
ALPHA = bytes.fromhex("00 00 40 00 00 00 C0 00 40 00 C0 00")
A = bytes.fromhex("00 00 00 00 28 0A 00 00 00 00 00 00")
D = bytes.fromhex("20 D0 00 00 00 00 24 00 00 00 04 1A")
TABLE = ALPHA + A + D
MAXES_2 = bytes.fromhex(
    "C6 03 3F FF 00 00 00 00 00 00 00 00 00 1F 3F 1F 3F 1F 3F 0F 9F 0F 9F 00 00"
)


def test_requests_are_the_bytes_of_the_specification():
    assert wire.END_SESSION == b"\xc5"
    assert bytes.fromhex("49 4D 4D 43") == wire.CALL
    assert bytes.fromhex("42 45 47 49 4E") == wire.BEGIN
    motion = wire.motion_request(Framing.HCI2, 300, timer=True)
    assert motion == bytes.fromhex(
        "CF 01 2C 23 7F FF FF FF FF FF FF FF FF 00 01 00 01 00 01 00 01 00 01 00 01"
    )
    assert len(motion) == 25
    assert len(wire.motion_request(Framing.HCI3, 10, timer=False)) == 29


def test_geometry_is_read_as_specified():
    kinematics = wire.kinematics_of(TABLE, "")
    quarter = math.pi / 2
    assert kinematics.alpha_rad == pytest.approx(
        (0, quarter, 0, -quarter, quarter, -quarter)
    )
    assert kinematics.a_mm == pytest.approx((0, 0, 260.35, 0, 0, 0))
    assert kinematics.d_mm == pytest.approx((213.36, 0, 0, 234.0864, 0, 26.67))
    assert kinematics.beta_rad == 0.0


def test_the_comment_says_whether_there_is_a_rotation_more():
    beta = wire.kinematics_of(TABLE + b"\xff\x00", "MicroScribe Beta 2").beta_rad
    assert beta == pytest.approx(-256 * math.pi / 32768)
    assert wire.kinematics_of(TABLE + b"\xff\x00", "calibrated").beta_rad == 0.0


@pytest.mark.parametrize(("size", "comment"), [(35, ""), (0, ""), (36, "Beta")])
def test_geometry_that_is_too_short_says_what_is_missing(size, comment):
    with pytest.raises(ValueError, match=f"has {size} bytes, expected 3[68]"):
        wire.kinematics_of(TABLE[:size], comment)


def test_greatest_counts_tell_the_framing():
    maxes = wire.maxes_reply(MAXES_2)
    assert maxes is not None
    assert maxes.framing is Framing.HCI2
    assert maxes.timer == 16383
    assert maxes.encoders == (7999, 7999, 7999, 3999, 3999, 0)


@pytest.mark.parametrize("width", ["H", "I"])
def test_greatest_counts_of_hci3_are_found_in_either_width(width):
    counts = (7999, 7999, 7999, 3999, 3999, 3999, 3999, 0)
    block = MAXES_2[:13] + struct.pack(f">8{width}", *counts)
    maxes = wire.maxes_reply(block.ljust(45, b"\0"))
    assert maxes is not None
    assert maxes.framing is Framing.HCI3
    assert maxes.encoders == counts


@pytest.mark.parametrize(
    "data",
    [
        MAXES_2[1:],
        MAXES_2[:-1],
        MAXES_2 + b"\0",
        MAXES_2[:13] + bytes(12),
        MAXES_2[:13] + b"\xff" * 12,
    ],
    ids=["no echo", "short", "long", "no encoder", "too great"],
)
def test_other_answers_are_no_greatest_counts(data):
    assert wire.maxes_reply(data) is None


def test_replies_are_found_behind_their_echo():
    assert wire.text_reply(0xC8, b"\x00\x12\xc8MicroScribe 3D\x00\x83") == (
        "MicroScribe 3D"
    )
    assert wire.counted_reply(0xC0, b"\xc0\x24" + TABLE + b"\x00") == TABLE
    assert wire.fixed_reply(0xC1, 12, b"\xc1" + A + b"\x00") == A
    assert wire.home_counts(A) == (0, 0, 10250, 0, 0, 0)


def test_every_prefix_of_a_reply_is_incomplete():
    text, counted, fixed = b"\xc8abc\x00", b"\xc0\x24" + TABLE, b"\xc1" + A
    for n in range(len(text)):
        assert wire.text_reply(0xC8, text[:n]) is None
    for n in range(len(counted)):
        assert wire.counted_reply(0xC0, counted[:n]) is None
    for n in range(len(fixed)):
        assert wire.fixed_reply(0xC1, 12, fixed[:n]) is None


@given(st.binary(max_size=400))
def test_noise_raises_nothing_but_what_is_documented(noise):
    text = wire.text_reply(0xC8, noise)
    assert text is None or (text.isprintable() and len(text) <= wire.LONGEST_TEXT)
    block = wire.counted_reply(0xC0, noise)
    assert block is None or block in noise
    wire.fixed_reply(0xC1, 12, noise)
    wire.maxes_reply(b"\xc6" + noise)
    if block is not None and len(block) >= 38:
        wire.kinematics_of(block, "Beta")


ENCODERS = (0, 4095, 2048, 1000, 16383, 128)
GOLDEN = bytes.fromhex("83 00 00 00 1F 7F 10 00 07 68 7F 7F 01 00")
GOLDEN_TIMED = bytes.fromhex("A3 01 09 52 00 00 1F 7F 10 00 07 68 7F 7F 01 00")
EIGHT = bytes.fromhex("83 02 00 01 00 02 00 03 00 04 00 05 00 06 00 07 7F 7F")
packets = st.builds(
    Packet,
    st.integers(0, 127),
    st.integers(0, 16383),
    st.tuples(*[st.integers(0, 16383)] * 6),
)


def packed(packet: Packet) -> bytes:
    """By arithmetic and not by shifts."""
    words = ([] if packet.timer is None else [packet.timer]) + list(packet.encoders)
    halves = [half for word in words for half in divmod(word, 128)]
    return bytes([0x83 if packet.timer is None else 0xA3, packet.buttons, *halves])


def decoded(chunks: list[bytes]) -> tuple[list[Packet], dict[str, int]]:
    decoder = PacketDecoder(Framing.HCI2, timer=True)
    packets = [packet for chunk in chunks for packet in decoder.feed(chunk)]
    return packets, {name: n for name, n in decoder.faults.items() if n}


def test_requests_of_packets_are_the_bytes_of_the_specification():
    assert packet_request(timer=False) == b"\x03"
    assert packet_request(timer=True) == b"\x23"
    assert packet_size(Framing.HCI2, timer=False) == 14
    assert packet_size(Framing.HCI2, timer=True) == 16
    assert packet_size(Framing.HCI3, timer=True) == 20


@pytest.mark.parametrize(
    ("timer", "framing", "data", "packet"),
    [
        (False, Framing.HCI2, GOLDEN, Packet(0, None, ENCODERS)),
        (True, Framing.HCI2, GOLDEN_TIMED, Packet(1, 1234, ENCODERS)),
        (False, Framing.HCI3, EIGHT, Packet(2, None, (*range(1, 8), 16383))),
    ],
)
def test_packets_are_read_as_specified(timer, framing, data, packet):
    decoder = PacketDecoder(framing, timer=timer)
    assert decoder.feed(data) == [packet]
    assert decoder.accepted == 1
    assert not decoder.faults
    assert not decoder.pending


def test_every_prefix_of_a_packet_is_incomplete():
    for n in range(1, len(GOLDEN_TIMED)):
        decoder = PacketDecoder(Framing.HCI2, timer=True)
        assert decoder.feed(GOLDEN_TIMED[:n]) == []
        assert decoder.pending
        assert decoder.feed(GOLDEN_TIMED[n:]) == [Packet(1, 1234, ENCODERS)]


@given(st.lists(packets, max_size=5), st.lists(st.integers(1, 40)))
def test_any_chunking_gives_the_same_packets(sent, sizes):
    data = b"".join(map(packed, sent))
    assert decoded(cut(data, sizes)) == (sent, {})


@given(st.lists(packets, min_size=3, max_size=3), st.integers(0, 15))
def test_a_lost_byte_costs_one_packet_only(sent, lost_byte):
    first, second, third = map(packed, sent)
    packets, faults = decoded(
        [first + second[:lost_byte] + second[lost_byte + 1 :] + third]
    )
    assert packets == [sent[0], sent[2]]
    assert faults == ({"stray": 15} if lost_byte == 0 else {"broken": 1})


@given(st.binary(max_size=300), st.lists(st.integers(1, 40)))
def test_noise_is_bounded_and_counted_alike_however_it_is_cut(noise, sizes):
    uncut, chunked = decoded([noise]), decoded(cut(noise, sizes))
    assert uncut == chunked
    packets, faults = uncut
    # Each packet has consumed its 16 bytes, and one first byte.
    assert 16 * len(packets) + faults.get("stray", 0) <= len(noise)
    assert len(packets) <= noise.count(0xA3)
    for packet in packets:
        assert packed(packet) in noise


@given(st.binary(max_size=100), packets)
def test_what_follows_noise_is_found_again(noise, packet):
    packets, _ = decoded([noise + packed(packet)])
    assert packets[-1] == packet


def test_what_was_not_requested_is_counted_and_skipped():
    packets, faults = decoded([GOLDEN + b"\xa3\x01" + GOLDEN_TIMED])
    assert packets == [Packet(1, 1234, ENCODERS)]
    assert faults == {"foreign": 1, "stray": 13, "broken": 1}

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.latch_board_frames import cut
from traverse.protocol.microscribe.packets import (
    Framing,
    Packet,
    PacketDecoder,
    packet_request,
    packet_size,
)

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
    found = [packet for chunk in chunks for packet in decoder.feed(chunk)]
    return found, {name: n for name, n in decoder.faults.items() if n}


def test_requests_are_the_bytes_of_the_specification():
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
def test_a_lost_byte_costs_one_packet_only(sent, at):
    first, second, third = map(packed, sent)
    found, faults = decoded([first + second[:at] + second[at + 1 :] + third])
    assert found == [sent[0], sent[2]]
    assert faults == ({"stray": 15} if at == 0 else {"broken": 1})


@given(st.binary(max_size=300), st.lists(st.integers(1, 40)))
def test_noise_is_bounded_and_counted_alike_however_it_is_cut(noise, sizes):
    whole, chunked = decoded([noise]), decoded(cut(noise, sizes))
    assert whole == chunked
    found, faults = whole
    # Each packet has consumed its 16 bytes, and one first byte.
    assert 16 * len(found) + faults.get("stray", 0) <= len(noise)
    assert len(found) <= noise.count(0xA3)
    for packet in found:
        assert packed(packet) in noise


@given(st.binary(max_size=100), packets)
def test_what_follows_noise_is_found_again(noise, packet):
    found, _ = decoded([noise + packed(packet)])
    assert found[-1] == packet


def test_what_was_not_requested_is_counted_and_skipped():
    found, faults = decoded([GOLDEN + b"\xa3\x01" + GOLDEN_TIMED])
    assert found == [Packet(1, 1234, ENCODERS)]
    assert faults == {"foreign": 1, "stray": 13, "broken": 1}

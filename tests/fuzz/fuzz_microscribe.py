"""Packets and answers of a MicroScribe: every packet is in the bytes."""

import contextlib
import math

from tests.fuzz.chunks import chunks
from traverse.protocol.microscribe import packets, session
from traverse.protocol.microscribe.packets import Framing, Packet, PacketDecoder

GOLDEN = "83 00 00 00 1F 7F 10 00 07 68 7F 7F 01 00"
TIMED = "A3 01 09 52 00 00 1F 7F 10 00 07 68 7F 7F 01 00"
GEOMETRY = "C0 24 " + "40 00 " * 6 + "28 0A " * 12
SEEDS = tuple(
    bytes.fromhex(text)
    for text in (
        f"00 04 {GOLDEN}",
        f"02 FF {TIMED} {TIMED}",
        "01 FF 83 " + "00 01 " * 8 + "02",
        f"00 00 {GEOMETRY}",
        "00 00 C8 4D 69 63 72 6F 00",
        "00 00 C6 " + "00 " * 12 + "3F FF " * 6,
    )
)


def written(packet: Packet) -> bytes:
    words = ([] if packet.timer is None else [packet.timer]) + list(packet.encoders)
    halves = [half for word in words for half in divmod(word, 128)]
    return bytes([0x83 if packet.timer is None else 0xA3, packet.buttons, *halves])


def check(data: bytes) -> None:
    """The first byte chooses the framing and whether there is a timer."""
    chosen = data[0] if data else 0
    framing = Framing.HCI3 if chosen & 1 else Framing.HCI2
    timer = bool(chosen & 2)
    size = packets.packet_size(framing, timer=timer)
    decoder = PacketDecoder(framing, timer=timer)
    decoded = [p for chunk in chunks(data[1:]) for p in decoder.feed(chunk)]
    heard = data[2:]
    assert len(decoder._begun) < size
    assert len(decoded) == decoder.accepted <= len(heard) // size
    offset = 0
    for packet in decoded:
        offset = heard.index(written(packet), offset) + size
    check_answers(heard)


def check_answers(heard: bytes) -> None:
    for command in session.TEXTS.values():
        text = session.text_reply(command, heard)
        assert text is None or text.isprintable()
    maxes = session.maxes_reply(heard)
    if maxes is not None:
        assert len(maxes.encoders) == maxes.framing.n_encoders
    block = session.counted_reply(session.GEOMETRY, heard)
    for comment in ("", "Beta"):
        with contextlib.suppress(ValueError):
            kinematics = session.kinematics_of(block or b"", comment)
            assert max(map(abs, kinematics.alpha_rad)) <= math.pi
            assert len(kinematics.a_mm) == len(kinematics.d_mm) == 6
    home = session.fixed_reply(session.HOME, 12, heard)
    if home is not None:
        assert len(session.home_counts(home)) == 6

"""Frames of docs/serial-protocol.md, section 6, copied from the page by hand."""

from itertools import pairwise

HELLO_REQUEST = "07 01 01 01 01 54 E6 00"
CONFIGURE = "0A 02 02 03 E8 03 88 13 88 13 01 03 31 40 00"
START_1_KHZ = "06 03 03 40 42 0F 03 4D 23 00"
STOP = "05 04 04 4F 91 00"
LATCH = "05 05 05 5F B2 00"
EDGE_ACK_258 = "04 06 02 01 01 03 D1 06 00"
HELLO = (
    "04 81 01 01 09 54 52 41 56 45 52 53 45 01 01 0B 07 01 02 03 02 02 01 40 42 0F 04 "
    "80 96 98 06 EF BE AD DE 17 01 02 80 02 20 01 02 10 03 3E 5A 00"
)
REPLY = "04 82 03 03 04 40 42 0F 03 14 58 00"
SAMPLE = "02 83 04 03 01 2A 01 01 03 10 27 01 04 01 02 03 04 FF FF 7F 01 04 02 79 1F 00"
EDGE = "02 84 04 01 01 07 01 01 03 11 27 01 04 01 02 03 04 FF FF 7F 01 01 03 33 3A 00"
TEMPERATURES = "04 85 11 27 01 03 FC 08 04 80 8F 35 00"
ALARM = "05 86 01 01 01 01 01 01 01 03 12 27 01 03 5E 01 01 03 E0 0D 00"
HEARTBEAT = (
    "03 87 01 01 03 13 27 01 02 2B 01 01 02 08 01 01 01 01 01 01 01 01 01 01 03 05 E6 "
    "00"
)
FROM_BOARD = [HELLO, REPLY, SAMPLE, EDGE, TEMPERATURES, ALARM, HEARTBEAT]


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


def crc_bit_by_bit(data: bytes) -> int:
    """CRC-16/IBM-3740 by its definition, one bit at a time."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
            crc &= 0xFFFF
    return crc


def stuffed(content: bytes) -> bytes:
    """COBS by its definition, distance to the next zero; for under 254 bytes."""
    out = bytearray(b"\0" + content + b"\0")
    zeros = [0, *(i + 1 for i, byte in enumerate(content) if byte == 0), len(out) - 1]
    for zero, following in pairwise(zeros):
        out[zero] = following - zero
    return bytes(out)


def framed(body: bytes) -> bytes:
    """A whole frame, made without the code under test."""
    return stuffed(body + crc_bit_by_bit(body).to_bytes(2, "little"))


def cut(data: bytes, cuts: list[int]) -> list[bytes]:
    places = [0, *sorted(c % (len(data) + 1) for c in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(places)]

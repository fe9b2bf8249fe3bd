"""Bodies of a board's frames, packed by docs/serial-protocol.md, section 4."""

import struct
from collections.abc import Sequence

BOARD_ID = bytes.fromhex("545241564552534500000007")
Channels = Sequence[tuple[int, int]]


def hello(
    request: int,
    *,
    major: int = 1,
    boot_id: int = 0xDEADBEEF,
    tick_rate_hz: int = 1_000_000,
    channels: Channels = ((23, 1 << 23), (32, 1 << 20)),
    inputs: int = 2,
) -> bytes:
    head = struct.pack("<4B", 0x81, request, major, 0)
    numbers = struct.pack(
        "<3BIII", len(channels), inputs, 1, tick_rate_hz, 10_000_000, boot_id
    )
    described = b"".join(struct.pack("<BI", *channel) for channel in channels)
    return head + BOARD_ID + bytes((1, 2, 3)) + numbers + described


def reply(request_type: int, request: int, result: int = 0, value: int = 0) -> bytes:
    return struct.pack("<BBBBI", 0x82, request_type, request, result, value)


def _latch(counts: Sequence[int], status: Sequence[int] | None) -> bytes:
    return struct.pack(f"<{len(counts)}I", *counts) + bytes(status or [0] * len(counts))


def sample(
    request: int,
    seq: int,
    ticks: int,
    counts: Sequence[int],
    *,
    cause: int = 0,
    inputs: int = 0,
    status: Sequence[int] | None = None,
) -> bytes:
    head = struct.pack("<BBBBII", 0x83, cause, request, inputs, seq, ticks % (1 << 32))
    return head + _latch(counts, status)


def edge(number: int, level: int, seq: int, ticks: int, counts: Sequence[int]) -> bytes:
    inputs = level << number
    head = struct.pack("<BBBBII", 0x84, number, level, inputs, seq, ticks % (1 << 32))
    return head + _latch(counts, None)


def temperatures(ticks: int, *hundredths: int) -> bytes:
    return struct.pack(f"<BI{len(hundredths)}h", 0x85, ticks % (1 << 32), *hundredths)


def alarm(channel: int, state: int, code: int, value: int) -> bytes:
    return struct.pack("<BBBHIIi", 0x86, channel, state, code, 0, 0, value)


def heartbeat(
    state: int,
    ticks: int,
    next_sample: int,
    next_edge: int,
    *,
    dropped: int = 0,
    back: int = 0,
) -> bytes:
    numbers = (ticks % (1 << 32), next_sample, next_edge, dropped, 0)
    return struct.pack("<4B5I", 0x87, state, 0, back, *numbers)

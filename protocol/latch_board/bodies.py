"""Bodies of frames to values (docs/serial-protocol.md, section 4).

A parser returns None where the length is wrong. Bodies of timed samples that follow one
another become one block.
"""

import struct
from collections.abc import Callable

import numpy as np

from traverse.protocol.latch_board.messages import (
    EDGE,
    NO_SENSOR,
    Alarm,
    Channel,
    Edge,
    Heartbeat,
    Hello,
    Latched,
    Message,
    Reply,
    SampleBlock,
    Temperatures,
)

TIMED = b"\x02\x83"
"""How the frame of a timed sample begins, and no other: its type, then a token of 0."""


def _sample_dtype(n_channels: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("head", "u1", (3,)),
            ("inputs", "u1"),
            ("seq", "<u4"),
            ("ticks", "<u4"),
            ("counts", "<u4", (n_channels,)),
            ("status", "u1", (n_channels,)),
        ]
    )


_SAMPLE_DTYPES = {n: _sample_dtype(n) for n in range(1, 48)}


def sample_block(bodies: list[bytes]) -> SampleBlock:
    """Bodies of one stream and one length as a block."""
    rows = np.frombuffer(b"".join(bodies), _SAMPLE_DTYPES[(len(bodies[0]) - 12) // 5])
    return SampleBlock(
        bodies[0][2],
        rows["seq"],
        rows["ticks"],
        rows["inputs"],
        rows["counts"],
        rows["status"],
    )


_HELLO = struct.Struct("<BBBB12s3sBBBIII")  # type request major minor id firmware ...
_CHANNEL = struct.Struct("<BI")  # bits modulus
_REPLY = struct.Struct("<BBBBI")  # type request_type request result value
_LATCHED = struct.Struct("<BBBBII")  # type, three bytes, seq ticks; counts, status
_ALARM = struct.Struct("<BBBHIIi")  # type channel state code seq ticks value
_HEARTBEAT = struct.Struct("<BBBBIIIII")


def _parse_hello(body: bytes) -> Hello | None:
    if len(body) < _HELLO.size:
        return None
    _, request, major, minor, board_id, firmware, n_channels, *more = (
        _HELLO.unpack_from(body)
    )
    n_inputs, n_temperatures, tick_rate_hz, max_rate, boot_id = more
    described = body[_HELLO.size :]
    if len(described) != n_channels * _CHANNEL.size:
        return None
    channels = tuple(
        Channel(bits, modulus or 1 << bits)
        for bits, modulus in _CHANNEL.iter_unpack(described)
    )
    return Hello(
        request,
        (major, minor),
        board_id,
        (firmware[0], firmware[1], firmware[2]),
        n_inputs,
        n_temperatures,
        tick_rate_hz,
        max_rate / 1000,
        boot_id,
        channels,
    )


def _parse_reply(body: bytes) -> Reply | None:
    return Reply(*_REPLY.unpack(body)[1:]) if len(body) == _REPLY.size else None


def _latch(body: bytes) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    n_channels, left = divmod(len(body) - _LATCHED.size, 5)
    if n_channels < 0 or left:
        return None
    counts = struct.unpack_from(f"<{n_channels}I", body, _LATCHED.size)
    return counts, tuple(body[len(body) - n_channels :])


def _parse_latched(body: bytes) -> Latched | None:
    values = _latch(body)
    if values is None:
        return None
    _, _, request, inputs, _, ticks = _LATCHED.unpack_from(body)
    return Latched(request, inputs, ticks, *values)


def _parse_edge(body: bytes) -> Edge | None:
    values = _latch(body)
    if values is None:
        return None
    _, number, level, inputs, seq, ticks = _LATCHED.unpack_from(body)
    return Edge(number, level, inputs, seq, ticks, *values)


def _parse_temperatures(body: bytes) -> Temperatures | None:
    count, left = divmod(len(body) - 5, 2)
    if count < 0 or left:
        return None
    ticks, *raw = struct.unpack(f"<I{count}h", body[1:])
    return Temperatures(ticks, tuple(None if v == NO_SENSOR else v / 100 for v in raw))


def _parse_alarm(body: bytes) -> Alarm | None:
    if len(body) != _ALARM.size:
        return None
    _, channel, state, code, seq, ticks, value = _ALARM.unpack(body)
    return Alarm(channel, state != 0, code, seq, ticks, value)


def _parse_heartbeat(body: bytes) -> Heartbeat | None:
    if len(body) != _HEARTBEAT.size:
        return None
    _, state, inputs, back, *rest = _HEARTBEAT.unpack(body)
    return Heartbeat(state == 1, inputs, back, *rest)


PARSERS: dict[int, Callable[[bytes], Message | None]] = {
    0x81: _parse_hello,
    0x82: _parse_reply,
    0x83: _parse_latched,
    EDGE: _parse_edge,
    0x85: _parse_temperatures,
    0x86: _parse_alarm,
    0x87: _parse_heartbeat,
}

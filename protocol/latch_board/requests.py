"""Requests to a latching board, as bytes (docs/serial-protocol.md, section 3)."""

import struct

from traverse.protocol.latch_board.framing import encode_frame
from traverse.protocol.latch_board.messages import (
    CONFIGURE,
    EDGE_ACK,
    HELLO,
    LATCH,
    MAJOR,
    START,
    STOP,
)


def hello_request(request: int, flags: int = 0) -> bytes:
    """Request the identity; with `FORGET_EDGES`, drop edges not yet acknowledged."""
    return encode_frame(bytes((HELLO, request, MAJOR, flags)))


def configure_request(
    request: int,
    edge_mask: int,
    heartbeat_ms: int,
    temperature_ms: int,
    debounce_us: int,
) -> bytes:
    """Set which inputs report edges, how often the board reports, the debouncing."""
    fields = (request, edge_mask, heartbeat_ms, temperature_ms, debounce_us)
    return encode_frame(struct.pack("<BBBHHI", CONFIGURE, *fields))


def start_request(request: int, rate_millihz: int) -> bytes:
    """Start a timed stream."""
    return encode_frame(struct.pack("<BBI", START, request, rate_millihz))


def stop_request(request: int) -> bytes:
    """Stop the timed stream."""
    return encode_frame(bytes((STOP, request)))


def latch_request(request: int) -> bytes:
    """Latch once, now."""
    return encode_frame(bytes((LATCH, request)))


def edge_ack(seq: int) -> bytes:
    """Acknowledge all edges up to ``seq``."""
    return encode_frame(struct.pack("<BI", EDGE_ACK, seq))

"""The latching controller board: requests to bytes, bytes to values.

Byte layouts are those of docs/serial-protocol.md, sections 3 and 4. Decoding works
on whole reads: timed samples that follow one another become one `SampleBlock`.
"""

from traverse.protocol.latch_board.decoder import Decoder
from traverse.protocol.latch_board.messages import (
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
from traverse.protocol.latch_board.numbers import (
    ALARMS,
    CONFIGURE,
    EDGE,
    EDGE_ACK,
    FORGET_EDGES,
    HELLO,
    LATCH,
    MAJOR,
    NO_SENSOR,
    REQUEST_NAMES,
    RESULTS,
    START,
    STATUS_ERROR,
    STATUS_LATE,
    STATUS_STALE,
    STATUS_WARNING,
    STOP,
    WHOLE_BOARD,
)
from traverse.protocol.latch_board.requests import (
    configure_request,
    edge_ack,
    hello_request,
    latch_request,
    start_request,
    stop_request,
)
from traverse.protocol.latch_board.samples import TIMED

__all__ = [
    "ALARMS",
    "CONFIGURE",
    "EDGE",
    "EDGE_ACK",
    "FORGET_EDGES",
    "HELLO",
    "LATCH",
    "MAJOR",
    "NO_SENSOR",
    "REQUEST_NAMES",
    "RESULTS",
    "START",
    "STATUS_ERROR",
    "STATUS_LATE",
    "STATUS_STALE",
    "STATUS_WARNING",
    "STOP",
    "TIMED",
    "WHOLE_BOARD",
    "Alarm",
    "Channel",
    "Decoder",
    "Edge",
    "Heartbeat",
    "Hello",
    "Latched",
    "Message",
    "Reply",
    "SampleBlock",
    "Temperatures",
    "configure_request",
    "edge_ack",
    "hello_request",
    "latch_request",
    "start_request",
    "stop_request",
]

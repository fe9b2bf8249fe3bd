"""Cut messages that are longer than the packets which a broker takes.

The points of a scan's block are numbered, so that it can be sent as several blocks. A
status loses lists that events have too: without any status nobody would know that the
daemon is there. No other message can be cut.
"""

from dataclasses import replace
from itertools import pairwise

from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.protocol.encoding import Encoding, decode, encode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Scan, Status
from traverse.protocol.messages.scan import ARRAYS

KINDS = frozenset({"scan", "spooled", "resend"})  # where there may be blocks of scans
STATUS_LISTS: dict[str, object] = {"probes": None, "alarms": (), "conditions": ()}
"""What a status that is too long is sent without, in this order."""


def cut_to_fit(
    kind: str, message: OutgoingMessage, limit_bytes: int
) -> list[OutgoingMessage]:
    """Cut into messages of at most so many bytes; none if that is impossible.

    The last of them tells when the whole has been sent.
    """
    if kind == "status":
        return _shortened(message, limit_bytes)
    if kind not in KINDS or limit_bytes <= 0:
        return []
    try:
        block = decode(Scan, message.payload, max_bytes=len(message.payload))
    except MessageError:
        return []
    encoding: Encoding = "json" if message.payload[:1] == b"{" else "msgpack"
    n_points = len(block.dtime_ns)
    n_parts = -(-len(message.payload) // limit_bytes)
    while n_parts <= n_points:
        bounds = [n_points * k // n_parts for k in range(n_parts + 1)]
        payloads = [
            encode(_part(block, begin, end), encoding)
            for begin, end in pairwise(bounds)
        ]
        if max(map(len, payloads)) <= limit_bytes:
            parts = [replace(message, payload=p, sent=None) for p in payloads]
            parts[-1] = replace(parts[-1], sent=message.sent)
            return parts
        n_parts += max(1, n_parts // 4)
    return []


def _shortened(message: OutgoingMessage, limit_bytes: int) -> list[OutgoingMessage]:
    status = decode(Status, message.payload, max_bytes=len(message.payload))
    for name, nothing in STATUS_LISTS.items():
        status = status.model_copy(update={name: nothing})
        payload = encode(status, status.encoding)
        if len(payload) <= limit_bytes:
            return [replace(message, payload=payload)]
    return []


def _part(block: Scan, begin: int, end: int) -> Scan:
    """Points ``begin`` to ``end`` of a block; the last part ends the scan."""
    is_last = end == len(block.dtime_ns)
    before_ns = int(block.dtime_ns[begin])
    arrays = {
        name: None if values is None else values[begin:end]
        for name, values in ((name, getattr(block, name)) for name in ARRAYS)
    }
    return block.model_copy(
        update={
            **arrays,
            "seq": block.seq + begin,
            "time_ns": block.time_ns + before_ns,
            "dtime_ns": block.dtime_ns[begin:end] - before_ns,
            "last": block.last and is_last,
            "total": block.total if is_last else None,
        }
    )

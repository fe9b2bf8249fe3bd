"""Points of an outbox as a table or as messages in JSON."""

from collections.abc import Iterable
from typing import IO

from traverse.client.exports.text import Csv, JsonLines
from traverse.daemon.store.records import StoredMessage
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point

FORMATS = {"csv": Csv, "jsonl": JsonLines}


def write_points(
    messages: Iterable[StoredMessage], file: IO[bytes], as_format: str
) -> tuple[int, list[str]]:
    """Write messages; return how many were written, and errors of the others."""
    unreadable = []
    sink = FORMATS[as_format](file)
    sink.points([])
    for message in messages:
        if not message.is_whole:
            unreadable.append(f"seq {message.seq!r}: damaged, and left out")
            continue
        try:
            point = decode(Point, message.payload, message.encoding)
        except MessageError as error:
            unreadable.append(f"{message.id}: cannot be read and is left out: {error}")
            continue
        sink.points([point])
    return sink.n, unreadable

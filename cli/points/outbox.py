"""An outbox: opened, its sessions and points as lines, tables or messages."""

import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from traverse.client.exports.text import Csv, JsonLines
from traverse.daemon.state_dir import DOUBTS
from traverse.daemon.store.queries import open_read_only
from traverse.daemon.store.records import (
    DatabaseRefusedError,
    StoredMessage,
    StoredSession,
)
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point
from traverse.protocol.messages.later_doubt import (
    LaterDoubt,
    doubts_of_lines,
    flagged_by,
)
from traverse.protocol.printable import printable
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.ownership import refused_owner

FORMATS = {"csv": Csv, "jsonl": JsonLines}


@contextmanager
def opened_outbox(path: Path) -> Iterator[sqlite3.Connection]:
    """Open an outbox to read it.

    Raises:
        ValueError: it is no outbox, or cannot be read.
    """
    try:
        with closing(open_read_only(path)) as connection:
            yield connection
    except DatabaseRefusedError as error:
        raise ValueError(str(error)) from error
    except (sqlite3.Error, UnicodeDecodeError) as error:  # its message may be damaged
        text = printable(str(error))
        remedy = refused_owner(path) or "check file and rights"
        raise ValueError(f"{path}: cannot be read: {text}; {remedy}") from error


def doubts_beside(outbox: Path) -> list[LaterDoubt]:
    """Read what is in doubt since it was stored.

    Raises:
        ValueError: the file beside the outbox is damaged.
    """
    path = outbox.with_name(DOUBTS)
    try:
        with open_regular(path) as file:
            return doubts_of_lines(file.read().decode())
    except FileNotFoundError:
        return []
    except ValueError as error:
        raise ValueError(f"{path}: is damaged; restore or remove it") from error


def session_line(
    session: StoredSession, points: int, unsent: int, *, as_json: bool
) -> str:
    if as_json:
        fields = {**asdict(session), "begun_ns": str(session.begun_ns)}
        return json.dumps({**fields, "points": points, "unsent": unsent})
    begun_utc = datetime.fromtimestamp(session.begun_ns // 10**9, UTC)
    left = f", {unsent} not sent yet" if unsent else ""
    note = f"  {session.note}" if session.note else ""
    return printable(
        f"{session.session}  {begun_utc:%Y-%m-%d %H:%M:%S} UTC  {session.first_seq} to "
        f"{session.last_seq}{left}{note}"
    )


def point_line(
    message: StoredMessage, doubts: Sequence[LaterDoubt] = (), *, as_json: bool
) -> str:
    if not message.is_whole:
        if as_json:
            return json.dumps({"damaged": True, "seq": str(message.seq)})
        return f"{message.seq!r:>7}  damaged"
    if as_json:
        return json.dumps(
            {
                "session": message.session,
                "seq": message.seq,
                "id": message.id,
                "time_ns": str(message.time_ns),
                "sent": message.is_sent,
            }
        )
    moment = datetime.fromtimestamp(message.time_ns // 10**9, UTC)
    sent = "sent    " if message.is_sent else "not sent"
    content = _content(message, doubts)
    return f"{message.seq:7d}  {moment:%Y-%m-%d %H:%M:%S} UTC  {sent}  {content}"


def _content(message: StoredMessage, doubts: Sequence[LaterDoubt]) -> str:
    try:
        stored = decode(Point, message.payload, message.encoding)
    except MessageError as error:
        return f"cannot be read: {error}"
    point = flagged_by(doubts, stored)
    if point.retracts is not None:
        return f"retracts {point.retracts}"
    x, y, z = point.xyz_mm
    words = [w for w in (point.label.artefact, point.label.feature) if w is not None]
    flags = "" if point.quality.ok else "  " + ",".join(point.quality.flags)
    text = f"{x:10.4f} {y:10.4f} {z:10.4f} mm  {' '.join(words)}{flags}"
    return printable(text).rstrip()


def write_points(
    messages: Iterable[StoredMessage],
    doubts: Sequence[LaterDoubt],
    file: IO[bytes],
    as_format: str,
) -> tuple[int, list[str]]:
    """Write messages; return how many were written, and errors of the others.

    Signed points in JSON remain as they were signed.
    """
    unreadable = []
    sink = FORMATS[as_format](file)
    sink.points([])
    for message in messages:
        point = point_of(message)
        if isinstance(point, str):
            unreadable.append(point)
        else:
            is_evidence = as_format == "jsonl" and point.signature is not None
            sink.points([point if is_evidence else flagged_by(doubts, point)])
    return sink.n, unreadable


def point_of(message: StoredMessage) -> Point | str:
    if not message.is_whole:
        return f"seq {message.seq!r}: damaged, and left out"
    try:
        return decode(Point, message.payload, message.encoding)
    except MessageError as error:
        return f"{message.id}: cannot be read and is left out: {error}"

"""Sources of points and scans: outboxes, recordings, lines of JSON."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from traverse.arrays import Integers
from traverse.cli.points.command import LAST
from traverse.cli.points.outbox import doubts_beside, opened_outbox
from traverse.client.exports.point_table import PointTable, scan_table
from traverse.daemon.store.queries import iter_messages, read_sessions
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point
from traverse.protocol.messages.later_doubt import (
    LaterDoubt,
    flagged_by,
)
from traverse.recording.run_reader import RunReader
from traverse.recording.views import (
    COVARIANCES,
    Cloud,
    bytes_to_cloud,
    bytes_to_doubt,
    columns_of,
)
from traverse.strict_toml.files import open_regular

SQLITE = b"SQLite format 3\x00"
MCAP = b"\x89MCAP0\r\n"
PIECE = 5000


def points_of(source: Path) -> Iterator[Point]:
    """All points and retractions of a file, in their order.

    Those of a recording and of an outbox have the flags of events that put them in
    doubt afterwards.

    Raises:
        ValueError: it is no such file, or a point in it cannot be read.
        OSError: it cannot be read.
    """
    with open_regular(source) as file:
        head = file.read(16)
    if head == SQLITE:
        doubts = doubts_beside(source)
        yield from (flagged_by(doubts, point) for point in _of_outbox(source))
    elif head.startswith(MCAP):
        doubts = _doubts_of(source)
        with RunReader(source) as run:
            for entry in run:
                if entry.topic == "point":
                    yield flagged_by(doubts, Point.model_validate_json(entry.content))
    elif head[:1] == b"{":
        yield from _of_lines(source)
    else:
        raise ValueError(
            f"{source}: is no recording (MCAP), no outbox (SQLite) and no points in "
            "JSON lines"
        )


def clouds_of(source: Path) -> Iterator[Cloud]:
    """Blocks of all scans of a recording, with flags of later events.

    Raises:
        ValueError: it is no recording.
        OSError: it cannot be read.
    """
    doubts = _doubts_of(source)
    with RunReader(source) as run:
        for entry in run:
            if entry.topic == "cloud":
                yield _doubted_cloud(bytes_to_cloud(entry.content), doubts)


def scans_of(source: Path) -> Iterator[PointTable]:
    """As `clouds_of`, as columns."""
    yield from map(_table, clouds_of(source))


def tear_of(source: Path) -> str | None:
    """Return why a recording ends before its file; None if it does not."""
    with open_regular(source) as file:
        if not file.read(len(MCAP)).startswith(MCAP):
            return None
    with RunReader(source) as run:
        for _ in run:
            pass
        return run.tear


def _doubts_of(recording: Path) -> list[LaterDoubt]:
    with RunReader(recording) as run:
        events = (bytes_to_doubt(e.content) for e in run if e.topic == "log")
        return [doubt for doubt in events if doubt is not None]


def _doubted_cloud(cloud: Cloud, doubts: Sequence[LaterDoubt]) -> Cloud:
    if not doubts:
        return cloud
    points, time_ns = cloud.points.copy(), _times_ns(cloud)
    for doubt in doubts:
        points["quality"][doubt.concerns(time_ns)] |= np.uint32(doubt.bits)
    return replace(cloud, points=points)


def _times_ns(cloud: Cloud) -> Integers:
    after_ns = np.rint(cloud.points["after_s"] * 1e9)
    return np.asarray(cloud.time_ns + after_ns.astype(np.int64))


def _table(cloud: Cloud) -> PointTable:
    points = cloud.points
    return scan_table(
        cloud.session,
        cloud.scan,
        seq=points["number"].astype(np.int64),
        time_ns=_times_ns(cloud),
        xyz_mm=columns_of(points, [f"{axis}_mm" for axis in "xyz"]),
        ijk=columns_of(points, "ijk"),
        quality=points["quality"].astype(np.uint32),
        covariance_mm2=columns_of(points, COVARIANCES),
    )


def _of_outbox(source: Path) -> Iterator[Point]:
    with opened_outbox(source) as connection:
        for session in read_sessions(connection, LAST):
            for held in iter_messages(connection, session.session, 0, LAST):
                if not held.is_whole:
                    raise ValueError(
                        f"{source}: the point of seq {held.seq!r} of session "
                        f"{session.session} is damaged; `traverse points export` "
                        "writes the others"
                    )
                try:
                    yield decode(Point, held.payload, held.encoding)
                except MessageError as error:
                    raise ValueError(f"{source}: {error}") from error


def _of_lines(source: Path) -> Iterator[Point]:
    with open_regular(source) as file:
        for number, line in enumerate(file, start=1):
            if not line.strip():
                continue
            try:
                yield decode(Point, line.strip(), "json")
            except MessageError as error:
                raise ValueError(f"{source}, line {number}: {error}") from error

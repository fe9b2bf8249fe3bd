"""Messages of arms as statements that put them into the tables, each at most once."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any

from traverse.client.results import StoredScan, StoredSession
from traverse.fleet.database import Database, Run, Values
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Event, Health, Point, Scan, Status


def _insert(table: str, columns: str, conflict: str = "DO NOTHING") -> str:
    marks = ", ".join(["%s"] * len(columns.split()))
    names = ", ".join(columns.split())
    return f"INSERT INTO {table} ({names}) VALUES ({marks}) ON CONFLICT {conflict}"


def _replace(table: str, columns: str, condition: str = "") -> str:
    changes = ", ".join(f"{name} = excluded.{name}" for name in columns.split()[1:])
    return _insert(table, columns, f"(arm) DO UPDATE SET {changes} {condition}")


_POINT = _insert(
    "point",
    "id arm session seq time_ns retracts x_mm y_mm z_mm part_x_mm part_y_mm part_z_mm "
    "std_mm temperature_c artefact feature ok flags model message",
)
_EVENT = _insert(
    "event",
    "arm session severity code source active first_ns last_ns count text remedy data",
)
_STATUS = _replace(
    "arm", "arm time_ns online state session model version alarms status"
)
_HEALTH = _replace(
    "health",
    "arm time_ns temperature_c points_unsent health",
    "WHERE excluded.time_ns >= health.time_ns",
)
_BLOCK = _insert("scan_block", "arm session scan seq points time_ns last total file")
_SERIES = """INSERT INTO series (arm, session, scan, first_ns, last_seq, complete_to)
    VALUES (%s, %s, %s, %s, %s, -1) ON CONFLICT (arm, session, scan) DO UPDATE SET
    last_seq = CASE WHEN excluded.last_seq > series.last_seq
        THEN excluded.last_seq ELSE series.last_seq END,
    first_ns = CASE WHEN excluded.first_ns < series.first_ns
        THEN excluded.first_ns ELSE series.first_ns END"""

_TEXT_END = 2000


@dataclass(slots=True)
class Rows:
    """Statements of a batch of messages, for one transaction."""

    points: list[Values] = field(default_factory=list)
    events: list[Values] = field(default_factory=list)
    statuses: dict[str, Values] = field(default_factory=dict)
    healths: dict[str, Values] = field(default_factory=dict)
    blocks: list[Values] = field(default_factory=list)
    series: dict[tuple[str, str, str], tuple[int, int]] = field(default_factory=dict)

    def add(self, kind: str, arm: str, payload: bytes) -> None:
        """Add the rows of a message; `add_block` adds scans, which are files.

        Raises:
            MessageError: the payload is no message of this kind.
        """
        match kind:
            case "point":
                self._add_point(decode(Point, payload), arm, payload)
            case "event":
                self._add_event(decode(Event, payload), arm)
            case "status":
                self._add_status(decode(Status, payload), arm, payload)
            case "health":
                self._add_health(decode(Health, payload), arm, payload)

    def add_block(self, scan: Scan, arm: str, file: str) -> None:
        """Note the file that holds a block of a scan."""
        n = len(scan.dtime_ns)
        place = (arm, scan.session, scan.scan)
        self.blocks.append(
            (*place, scan.seq, n, scan.time_ns, scan.last, scan.total, file)
        )
        # An empty last block says where the scan ends.
        self._reached(place, scan.time_ns, scan.seq + n - 1)

    def write(self, database: Database, run: Run) -> None:
        """Run all statements; rows in one order for all, so that none deadlocks."""
        for statement, rows in (
            (_POINT, sorted(self.points, key=itemgetter(0))),
            (_EVENT, self.events),
            (_STATUS, [self.statuses[arm] for arm in sorted(self.statuses)]),
            (_HEALTH, [self.healths[arm] for arm in sorted(self.healths)]),
            (_BLOCK, self.blocks),
            (_SERIES, [(*key, *self.series[key]) for key in sorted(self.series)]),
        ):
            if rows:
                database.many(run, statement, rows)

    def _reached(self, place: tuple[str, str, str], time_ns: int, seq: int) -> None:
        first_ns, last = self.series.get(place, (time_ns, seq))
        self.series[place] = (min(first_ns, time_ns), max(last, seq))

    def _add_point(self, point: Point, arm: str, payload: bytes) -> None:
        tensor = point.covariance_mm2
        std_mm = None
        if tensor is not None:
            std_mm = math.sqrt(max(tensor[0] + tensor[3] + tensor[5], 0.0))
        self.points.append(
            (
                *(point.id, arm, point.session, point.seq, point.time_ns),
                *(point.retracts, *point.xyz_mm),
                *(point.part_xyz_mm or (None, None, None)),
                *(std_mm, point.temperature_c),
                *(point.label.artefact, point.label.feature),
                *(point.quality.ok, " ".join(point.quality.flags)),
                *(point.model, payload),
            )
        )
        self._reached((arm, point.session, ""), point.time_ns, point.seq)

    def _add_event(self, event: Event, arm: str) -> None:
        self.events.append(
            (
                *(arm, event.session, event.severity, event.code, event.source),
                *(event.active, event.first_ns, event.last_ns, event.count),
                *(_printable(event.text), _printable(event.remedy)),
                json.dumps(event.data, default=str, sort_keys=True),
            )
        )

    def _add_status(self, status: Status, arm: str, payload: bytes) -> None:
        self.statuses[arm] = (
            *(arm, status.time_ns, status.online, status.state),
            *(status.session, status.model, status.version),
            len(status.alarms),
            payload,
        )

    def _add_health(self, health: Health, arm: str, payload: bytes) -> None:
        self.healths[arm] = (
            arm,
            health.time_ns,
            health.temperatures_c.get("arm"),
            health.outbox.unsent,
            payload,
        )


def _printable(text: str) -> str:
    """Remove NUL, which PostgreSQL refuses, and cut the text at its longest."""
    return text.replace("\0", "")[:_TEXT_END]


def refused_row(time_ns: int, topic: str, reason: str, payload: bytes) -> Values:
    """Make the row of a message that cannot be stored: its beginning, the reason."""
    return (time_ns, _printable(topic), _printable(reason), payload[:_TEXT_END])


def listed_series(database: Database, arm: str, listed: Mapping[str, Any]) -> None:
    """Store an arm's list of series, its answer to `resend` without arguments.

    Raises:
        StoreAwayError: the database is not there.
        MessageError: it is no such answer.
    """
    scans = [StoredScan.read(scan) for scan in listed.get("scans", ())]
    rows = [
        *(
            (arm, series.session, "", series.begun_ns, series.last_seq)
            for series in StoredSession.read_all(listed)
            if series.last_seq is not None
        ),
        *(
            (arm, series.session, series.scan, series.begun_ns, series.last_block_seq)
            for series in scans
            if series.last_block_seq is not None
        ),
    ]
    with database.transaction() as run:
        database.many(run, _SERIES, sorted(rows))

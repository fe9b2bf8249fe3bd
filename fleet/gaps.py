"""Missing numbers, found in the store, so that any member can request them.

A series is the points of a session, or the blocks of a scan. It is complete up to a
number; behind it every number that is neither stored nor lost is missing.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from traverse.fleet.database import Database, Run

_OPEN = """SELECT arm, session, scan, last_seq, complete_to, gap_since_ns FROM series
    WHERE complete_to < last_seq ORDER BY arm, first_ns, session, scan"""
_POINTS = """SELECT seq, 1 FROM point WHERE arm = %s AND session = %s AND seq > %s
    ORDER BY seq LIMIT %s"""
_BLOCKS = """SELECT seq, points FROM scan_block WHERE arm = %s AND session = %s
    AND scan = %s AND seq > %s ORDER BY seq LIMIT %s"""
_LOST = """SELECT from_seq, to_seq - from_seq + 1 FROM lost WHERE arm = %s
    AND session = %s AND scan = %s AND to_seq > %s ORDER BY from_seq"""
_UPDATE = """UPDATE series SET complete_to = %s, gap_since_ns = %s WHERE arm = %s
    AND session = %s AND scan = %s AND complete_to <= %s"""
MOST_ASKED = 500
"""Numbers asked for at once."""
_MOST_ROWS = 50_000
"""Looked at in one transaction, of one series."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Missing numbers, both ends included.

    Attributes:
        since_ns: when they were missed first.
    """

    arm: str
    session: str
    scan: str
    from_seq: int
    to_seq: int
    since_ns: int

    @property
    def series(self) -> tuple[str, str, str]:
        return self.arm, self.session, self.scan


def find_gaps(database: Database, now_ns: int) -> list[Gap]:
    """Find the first gap of each series, and move the series' marks up to it.

    Raises:
        StoreAwayError: the database is not there.
    """
    with database.transaction() as run:
        open_series = run(_OPEN)
    gaps = []
    for arm, session, scan, last_seq, complete_to, known_ns in open_series:
        since_ns = known_ns or now_ns
        with database.transaction() as run:
            place = (arm, session, scan)
            mark, missing = _missing(run, place, complete_to + 1, last_seq)
            after_ns = since_ns if missing else None
            if (mark, after_ns) != (complete_to, known_ns):
                run(_UPDATE, (mark, after_ns, *place, mark))
        if missing:
            gaps.append(Gap(*place, *_spanned(missing), since_ns))
    return gaps


def _spanned(missing: list[tuple[int, int]]) -> tuple[int, int]:
    """Return the first gap and those near it as one: members share number by number.

    Numbers between them arrive twice, which costs less than a request for each.
    """
    first = missing[0][0]
    last = first + MOST_ASKED - 1
    return first, max(min(end, last) for begin, end in missing if begin <= last)


def _missing(
    run: Run, place: tuple[str, str, str], first_seq: int, last_seq: int
) -> tuple[int, list[tuple[int, int]]]:
    """Return the last number of the complete part, and the numbers missing after it."""
    arm, session, scan = place
    if scan:
        ranges = run(_BLOCKS, (arm, session, scan, first_seq - 1, _MOST_ROWS))
    else:
        ranges = run(_POINTS, (arm, session, first_seq - 1, _MOST_ROWS))
    if len(ranges) == _MOST_ROWS:
        last_seq = min(last_seq, ranges[-1][0])
    ranges += run(_LOST, (arm, session, scan, first_seq - 1))
    gaps = list(_between(sorted(ranges), first_seq, last_seq))
    mark = gaps[0][0] - 1 if gaps else last_seq
    return mark, gaps


def _between(
    ranges: list[tuple[int, ...]], next_seq: int, last_seq: int
) -> Iterator[tuple[int, int]]:
    for first, n in ranges:
        if first > last_seq:
            break
        if first > next_seq:
            yield next_seq, first - 1
        next_seq = max(next_seq, first + n)
    if next_seq <= last_seq:
        yield next_seq, last_seq


def mark_lost(
    database: Database, gap: Gap, now_ns: int, reason: str
) -> list[tuple[int, int]]:
    """Record missing numbers as lost, except those stored meanwhile.

    Returns:
        The first and the last of each range that is lost.

    Raises:
        StoreAwayError: the database is not there.
    """
    with database.transaction() as run:
        _, missing = _missing(run, gap.series, gap.from_seq, gap.to_seq)
        for first, last in missing:
            run(
                "INSERT INTO lost (arm, session, scan, from_seq, to_seq, time_ns, "
                "reason) VALUES (%s, %s, %s, %s, %s, %s, %s) ON CONFLICT DO NOTHING",
                (*gap.series, first, last, now_ns, reason),
            )
    return missing


def take_lease(
    database: Database, name: str, member: str, now_ns: int, for_ns: int
) -> bool:
    """Return whether this member holds a named lease until its end.

    Raises:
        StoreAwayError: the database is not there.
    """
    with database.transaction() as run:
        run(
            "INSERT INTO lease (name, member, until_ns) VALUES (%s, %s, %s) "
            "ON CONFLICT (name) DO UPDATE SET member = excluded.member, "
            "until_ns = excluded.until_ns "
            "WHERE lease.until_ns < %s OR lease.member = excluded.member",
            (name, member, now_ns + for_ns, now_ns),
        )
        return run("SELECT member FROM lease WHERE name = %s", (name,)) == [(member,)]

"""Claims at the end of the crash test.

Also whether the daemon was at work: a run of 200 kills once ended well with 7 sessions
in 229 starts: for most of it the daemon had no board, so that nothing could be lost.
"""

import json
import math
import sqlite3
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from benchmarks.tools.sizes import IS_TINY
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Point

QUIET_S = 2.0  # presses are about 0.4 s apart
LEAST_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Span:
    """Time in which programs and networks were killed.

    Attributes:
        begun_s: UTC, as are all times of the logs.
    """

    begun_s: float
    ended_s: float
    starts: int


@dataclass(frozen=True, slots=True)
class Work:
    """Work of the daemon while programs and networks were killed.

    Attributes:
        measuring_s: of these with edges acknowledged, a pause of two seconds at most.
        sessions: with at least one point in the outbox.
    """

    seconds: float
    measuring_s: float
    starts: int
    sessions: int

    @property
    def share(self) -> float:
        return self.measuring_s / self.seconds if self.seconds > 0.0 else 0.0

    def faults(self) -> list[str]:
        """Return why the run shows too little; empty if it shows enough."""
        faults = []
        if self.share < LEAST_SHARE:
            faults.append(
                f"the daemon was measuring for {self.share:.0%} of {self.seconds:.0f} "
                f"s, at least {LEAST_SHARE:.0%} is needed to show anything; run again "
                "with --folder and see daemon.log, tap.log and board.log there"
            )
        if self.sessions < LEAST_SHARE * self.starts:
            faults.append(
                f"{self.sessions} sessions with points in {self.starts} starts of the "
                f"daemon, at least {LEAST_SHARE:.0%} of them are needed to show "
                "anything; run again with --folder and see why in daemon.log there"
            )
        return faults


def measuring_s(times_s: Iterable[float], begun_s: float, ended_s: float) -> float:
    """Return how long edges were acknowledged between two instants, without pauses."""
    within = [begun_s - 2 * QUIET_S]
    within += [time_s for time_s in times_s if begun_s <= time_s <= ended_s]
    return sum(b - a for a, b in pairwise(within) if b - a <= QUIET_S)


MAX_TOLD = 10


@dataclass(frozen=True, slots=True)
class Verdict:
    """Faults that were found.

    Attributes:
        figures: names to numbers, for the table.
        faults: sentences; empty where all is well.
    """

    figures: dict[str, int]
    faults: list[str]


def lines(path: Path) -> Iterator[dict[str, Any]]:
    """Lines of a log whose writer may have been killed in the middle of one."""
    if not path.exists():
        return
    for line in path.read_text("utf-8").splitlines():
        try:
            yield json.loads(line)
        except ValueError:
            continue


def outbox_points(path: Path) -> list[Point]:
    """Return the points on the daemon's disk, in the order of storing."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
        rows = database.execute("SELECT payload FROM messages ORDER BY number")
        return [decode(Point, payload) for (payload,) in rows]


def stored(path: Path) -> list[tuple[str, str, int]]:
    """Id, session and number of the consumer's points as they arrived."""
    with closing(sqlite3.connect(path)) as database:
        rows = database.execute("SELECT id, session, seq FROM points ORDER BY arrival")
        return rows.fetchall()


def judge(
    folder: Path, outbox: Path, lives: list[str], span: Span, n_other: int = 0
) -> Verdict:
    """Compare acknowledged, stored and received points.

    Args:
        folder: of the crash test.
        outbox: the daemon's database.
        lives: of the board.
        span: while programs were killed.
        n_other: points that others than the operator commanded.
    """
    points = outbox_points(outbox)
    received = stored(folder / "store.db")
    answers = list(lines(folder / "operator.jsonl"))
    acknowledged = {line["id"] for line in answers if line["ok"]}
    ids = [point_id for point_id, _, _ in received]
    held = {point.id for point in points}
    doubled = {point_id for point_id, n in Counter(ids).items() if n > 1}
    turns = _counts_per_turn(folder / "arm.toml")
    presses, edges = _edges(folder, lives, turns)
    buttons = [point for point in points if point.trigger == "button"]
    pressed = [_key(point.counts, turns) for point in buttons]
    twice = {key for key, n in Counter(pressed).items() if n > 1}
    lost, pointless = acknowledged - set(ids), edges - set(pressed)
    unheld, unpressed = set(ids) - held, set(pressed) - presses
    order = _order(received)
    faults = [
        *_some("acknowledged, but not in the store", lost),
        *_some("acknowledged edges without a point", pointless),
        *_some("in the outbox, but not in the store", held - set(ids)),
        *_some("in the store, but not in the outbox", unheld),
        *_some("invented: no press has these counts", unpressed),
        *_some("twice in the store", doubled),
        *_some("two points of one press", twice),
        *order[:MAX_TOLD],
    ]
    n_commanded = sum(point.trigger == "command" for point in points)
    if n_commanded > len(answers) + n_other + 100:
        faults.append(
            f"{n_commanded} commanded points, {len(answers) + n_other} requests"
        )
    figures = _figures(folder)
    if figures["lost"]:
        faults.append("the consumer was told of losses")
    refused = Counter(line["code"] for line in answers if not line["ok"])
    work = _work(folder, points, span)
    if not IS_TINY:  # which on a busy machine shows little or nothing
        if not acknowledged or not edges:
            faults.append("nothing was acknowledged: the test has shown nothing")
        faults += work.faults()
    return Verdict(
        {
            "sessions with points": work.sessions,
            "percent of the time measuring": round(100 * work.share),
            "commands sent": len(answers),
            "commands answered": len(answers) - refused["none"],
            "commands without answer": refused["none"],
            "commands refused": sum(refused.values()) - refused["none"],
            "commanded points acknowledged": len(acknowledged),
            "edges acknowledged": len(edges),
            "points in the outbox": len(points),
            "points in the store": len(received),
            "points asked for again": figures["resend_requested"],
            "duplicates removed": figures["duplicates"],
            "consumer's connections": figures["connections"],
            "acknowledged and lost": len(lost) + len(pointless),
            "reported as lost": figures["lost"],
            "invented": len(unheld) + len(unpressed),
            "doubled": len(doubled) + len(twice),
            "out of order": len(order),
        },
        faults,
    )


def _work(folder: Path, points: Sequence[Point], span: Span) -> Work:
    log = lines(folder / "acknowledged.jsonl")
    times_s = [line["time_s"] for line in log if "seq" in line]
    return Work(
        seconds=span.ended_s - span.begun_s,
        measuring_s=measuring_s(times_s, span.begun_s, span.ended_s),
        starts=span.starts,
        sessions=len({point.session for point in points}),
    )


def _order(received: list[tuple[str, str, int]]) -> list[str]:
    """Check sessions one after the other, numbers from 0 without gap."""
    faults, ended, current, expected = [], set(), "", 0
    for _, session, seq in received:
        if session != current:
            ended.add(current)
            current, expected = session, 0
            if session in ended:
                faults.append(f"session {session} goes on after another")
        if seq != expected:
            faults.append(f"session {session}: {seq} in the place of {expected}")
        expected = seq + 1
    return faults


def _counts_per_turn(arm: Path) -> tuple[int, ...]:
    joints = tomllib.loads(arm.read_text("utf-8"))["joints"]
    return tuple(joint["encoder"]["counts_per_turn"] for joint in joints)


def _edges(
    folder: Path, lives: list[str], turns: tuple[int, ...]
) -> tuple[set[tuple[int, ...]], set[tuple[int, ...]]]:
    promised = _promised(list(lines(folder / "acknowledged.jsonl")))
    presses, acknowledged = set(), set()
    for life in lives:
        for line in lines(folder / f"truth-{life}.jsonl"):
            if line["event"] == "edge" and line["level"] == 1:
                key = _key(line["counts"], turns)
                presses.add(key)
                if (life, line["seq"]) in promised:
                    acknowledged.add(key)
    return presses, acknowledged


def _promised(log: list[dict[str, Any]]) -> set[tuple[str, int]]:
    """Return life and number of edges whose acknowledgement promises a point.

    Edges that met a failing disk do not count: they are refused to the operator, and
    the acknowledgement may follow when the disk works again.
    """
    notes = [(line["time_s"], line["disk"]) for line in log if "disk" in line]
    notes.append((math.inf, True))
    bad = [(a, b) for (a, is_sound), (b, _) in pairwise(notes) if not is_sound]
    sound: set[tuple[str, int]] = set()
    spoiled: set[tuple[str, int]] = set()
    for line in log:
        if "seq" in line:
            met = any(line["sent_s"] <= b and a <= line["time_s"] for a, b in bad)
            (spoiled if met else sound).add((line["life"], line["seq"]))
    return sound - spoiled


def _key(counts: Sequence[int], turns: tuple[int, ...]) -> tuple[int, ...]:
    """Counts within a turn; noise makes them those of one press only."""
    return tuple(count % turn for count, turn in zip(counts, turns, strict=True))


def _figures(folder: Path) -> Counter[str]:
    """The consumer's counters, over all its lives."""
    total: Counter[str] = Counter()
    with closing(sqlite3.connect(folder / "store.db")) as database:
        for (text,) in database.execute("SELECT text FROM figures"):
            total.update(json.loads(text))
    return total


def _some(fault: str, cases: set[Any]) -> list[str]:
    if not cases:
        return []
    return [f"{len(cases)} {fault}: {sorted(cases)[:3]}"]

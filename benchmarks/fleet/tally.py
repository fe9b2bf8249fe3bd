"""Comparison of received with sent numbers, and costs."""

import json
import signal
import subprocess
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tools import rig

Process = subprocess.Popen[bytes]


@dataclass
class Group:
    """The consumers of one group and the files that they leave."""

    processes: list[Process]
    files: list[Path]

    def end(self) -> None:
        for process in self.processes:
            process.send_signal(signal.SIGTERM)
        for process in self.processes:
            process.wait(60)


@dataclass(frozen=True, slots=True)
class Cost:
    """CPU time so far, in seconds."""

    broker_s: float
    consumers_s: float

    @classmethod
    def of(cls, broker: Process, consumers: Sequence[Process]) -> "Cost":
        return cls(
            rig.cpu_s(broker), sum(rig.cpu_s(consumer) for consumer in consumers)
        )


@dataclass(frozen=True, slots=True)
class Shares:
    """Shares of one core, over a time."""

    broker: float
    consumers: float


def cost_of(
    before: Cost, broker: Process, consumers: Sequence[Process], taken_s: float
) -> Shares:
    now = Cost.of(broker, consumers)
    return Shares(
        (now.broker_s - before.broker_s) / taken_s,
        (now.consumers_s - before.consumers_s) / taken_s,
    )


@dataclass(frozen=True, slots=True)
class Sent:
    """Numbers sent by each arm, by kind.

    Attributes:
        expected: by arm and kind; empty: losses are counted from gaps alone.
        latest_s: greatest delay of the publisher itself.
    """

    expected: dict[tuple[str, str], int]
    latest_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Run:
    """Programs of a run."""

    subject: str
    arms: int
    rate_hz: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Fleet:
    """One run in figures.

    Attributes:
        numbers: points, and points of scans, that arrived.
        per_consumer: messages that each consumer had.
        broker_share, consumers_share, daemon_share: of one core; a daemon's is the
            mean of one.
        broker_mb: growth of the broker's memory.
        daemon_mb, daemon_own_mb: resident of one daemon, and without shared pages.
    """

    subject: str
    arms: int
    rate_hz: float
    seconds: float
    messages: int
    numbers: int
    megabytes: float
    missing: int
    doubled: int
    per_consumer: list[int]
    broker_share: float
    consumers_share: float
    broker_mb: float
    publisher_latest_s: float = 0.0
    daemon_share: float = 0.0
    daemon_mb: float = 0.0
    daemon_own_mb: float = 0.0
    boards_share: float = 0.0
    line_lost: int = 0
    start_s: float = 0.0

    def lines(self) -> str:
        text = (
            f"{self.arms} {self.subject} at {self.rate_hz:g} Hz for {self.seconds:g} s"
            f": {self.messages} messages, {self.numbers} points, "
            f"{self.megabytes:.1f} MB; "
            f"{self.missing} missing, {self.doubled} doubled; "
            f"consumers {self.per_consumer}\n"
            f"  mosquitto {self.broker_share:.1%} of a core "
            f"({self.broker_share / self.arms:.2%} an arm), {self.broker_mb:+.1f} MB; "
            f"three consumers {self.consumers_share:.1%}"
        )
        if self.daemon_share:
            text += (
                f"\n  a daemon {self.daemon_share:.1%} of a core, {self.daemon_mb:.0f} "
                f"MB resident ({self.daemon_own_mb:.0f} MB its own); boards "
                f"{self.boards_share:.1%}; {self.line_lost} lost or dropped before the "
                f"broker; started in {self.start_s:.0f} s"
            )
        if self.publisher_latest_s:
            text += f"\n  publisher late by {self.publisher_latest_s * 1e3:.0f} ms most"
        return text


def tally(
    run: Run, sent: Sent, consumers: Group, *, shares: Shares, broker_mb: float
) -> Fleet:
    had: dict[tuple[str, str, str], list[tuple[int, int]]] = defaultdict(list)
    per_consumer, n_bytes, line_lost = [], 0, 0
    for file in consumers.files:
        received = json.loads(file.read_text("utf-8"))
        per_consumer.append(len(received["had"]))
        n_bytes += received["bytes"]
        for arm, kind, series, first, n in received["had"]:
            had[arm, kind, series].append((first, n))
        line_lost += sum(sum(counts) for counts in received["losses"].values())
    missing = doubled = numbers = 0
    n_reached: dict[tuple[str, str], int] = defaultdict(int)
    for (arm, kind, _), blocks in had.items():
        reached, gaps, repeated = gaps_of(blocks)
        missing, doubled = missing + gaps, doubled + repeated
        n_reached[arm, kind] += reached
        numbers += sum(n for _, n in blocks)
    for key, expected in sent.expected.items():
        missing += max(0, expected - n_reached[key])
    return Fleet(
        run.subject,
        run.arms,
        run.rate_hz,
        run.seconds,
        sum(per_consumer),
        numbers,
        n_bytes / 1e6,
        missing,
        doubled,
        per_consumer,
        shares.broker,
        shares.consumers,
        broker_mb,
        sent.latest_s,
        line_lost=line_lost,
    )


def gaps_of(blocks: list[tuple[int, int]]) -> tuple[int, int, int]:
    """Return the last number of blocks (first, length), missing and doubled ones."""
    reached = missing = doubled = 0
    for first, n in sorted(blocks):
        missing += max(0, first - reached)
        doubled += max(0, min(reached, first + n) - first)
        reached = max(reached, first + n)
    return reached, missing, doubled

"""Losses on a MicroScribe's line: counted, and reported together regularly."""

from collections import Counter
from typing import Protocol

from traverse.drivers.microscribe.session import MicroscribeSession


class Fault(Protocol):
    """Reports a fault, as `Driver` does."""

    def __call__(self, code: str, text: str, remedy: str, count: int = 1) -> None:
        """Report it."""


class MicroscribeLosses:
    """Losses since the last report.

    Args:
        fault: reports one.
        counters: of the driver.

    Attributes:
        samples: of the stream.
        edges: of pedals.
    """

    def __init__(self, fault: Fault, counters: Counter[str]) -> None:
        self._fault = fault
        self._counters = counters
        self._rejected = 0  # reported of this line
        self.samples = self.edges = 0

    def begin(self) -> None:
        """Another line begins, which has rejected nothing."""
        self._rejected = 0

    def report(self, session: MicroscribeSession, path: str) -> None:
        """Report the losses of a session on a port."""
        line, faults = session.line, session.decoder.faults
        self._counters["bytes_stray"] = line.unrequested_bytes + faults["stray"]
        self._counters["packets_old"] = line.old
        self._counters["clock_steps"] = session.clock_steps
        if rejected := faults["broken"] + faults["foreign"] - self._rejected:
            self._rejected += rejected
            self._fault(
                "frames_rejected",
                f"{rejected} broken packets on {path}",
                "check cable, shielding and baud rate",
                rejected,
            )
        if edges := self.edges:
            self.edges = 0
            self._fault(
                "edges_lost",
                f"{edges} pedal edges were lost because they are not processed",
                "the daemon is overloaded; repeat the last points",
                edges,
            )
        if lost := self.samples:
            self.samples = 0
            self._fault(
                "samples_lost",
                f"{lost} samples lost between {session.arm.name} and host",
                "lower the rate, or check cable and adapter",
                lost,
            )

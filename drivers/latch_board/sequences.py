"""Sequences of a latch board's edges and samples: each once and in order.

The board numbers its edges and repeats them until they are acknowledged; an
acknowledgement covers all earlier edges too (docs/serial-protocol.md). An edge that
overtakes a broken one therefore waits for the repetition, unless the board itself has
lost the earlier one. Then the oldest that the board repeats is next.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Integers

WRAP = 1 << 32
MAX_JUMP = 1 << 20  # a hundred seconds at 10 kHz: no gap of a living stream
PATIENCE_NS = 1_000_000_000  # the board repeats every 50 ms

Verdict = Literal["next", "early", "waiting", "acknowledged"]


class EdgeSequencer:
    """The sequence of edges as received by the host.

    Attributes:
        expected: number of the next edge; None until the board reports it.
    """

    def __init__(self, expected: int | None = None) -> None:
        self.expected = expected
        self._delivered: int | None = None
        self._acknowledged: int | None = None
        self._oldest_missed: int | None = None
        self._sent: int | None = None
        self._early_since_ns: int | None = None
        self._oldest_early = 0

    @property
    def has_open_edges(self) -> bool:
        return self._delivered is not None and self._delivered != self._acknowledged

    @property
    def needs_acknowledgement(self) -> bool:
        return self.has_open_edges or self._acknowledged != self._sent

    def take_acknowledgement(self) -> int | None:
        """Return the number to acknowledge to the board; None if nothing is new."""
        if self._acknowledged == self._sent:
            return None
        self._sent = self._acknowledged
        return self._sent

    def note_missed(self, seq: int) -> None:
        if self._oldest_missed is None or _signed(seq - self._oldest_missed) < 0:
            self._oldest_missed = seq

    def begin_at(self, seq: int) -> int:
        """Take the board's first edge; used only at the beginning.

        Returns:
            How many earlier edges were forgotten, as far as one of them was seen.
        """
        if self.expected is not None:
            return 0
        self.expected = seq % WRAP
        oldest = self._oldest_missed
        return 0 if oldest is None else max(0, _signed(seq - oldest))

    def classify(self, seq: int, now_ns: int) -> tuple[Verdict, int]:
        """Classify edge ``seq``, and count earlier ones that are definitely lost.

        Returns:
            "next": deliver it, then call `mark_delivered`. "early": an earlier one is,
            or may be, missing: wait for it. "waiting": delivered, not yet acknowledged.
            "acknowledged": the acknowledgement was lost, `take_acknowledgement`
            repeats it.
        """
        if self.expected is None:
            return "early", 0  # an earlier one may be waiting: a heartbeat shows it
        ahead = _signed(seq - self.expected)
        if ahead < 0:
            done = self._acknowledged
            if done is None or _signed(seq - done) > 0:
                return "waiting", 0
            self._sent = None  # the acknowledgement was lost: repeat it
            return "acknowledged", 0
        if ahead == 0:
            return "next", 0
        if self._early_since_ns is None:
            self._early_since_ns, self._oldest_early = now_ns, seq
        if _signed(seq - self._oldest_early) < 0:
            self._oldest_early = seq
        waited_ns = now_ns - self._early_since_ns
        is_oldest = seq == self._oldest_early
        if waited_ns < PATIENCE_NS or not (is_oldest or waited_ns >= 2 * PATIENCE_NS):
            return "early", 0
        return "next", ahead

    def mark_delivered(self, seq: int) -> None:
        """Note that edge ``seq`` is being handed to the consumer."""
        self.expected = (seq + 1) % WRAP
        self._delivered = seq
        self._early_since_ns = None

    def mark_refused(self, seq: int) -> None:
        """The consumer had no room for edge ``seq``: the board must repeat it."""
        self.expected = seq
        self._delivered = (seq - 1) % WRAP

    def acknowledge(self, seq: int) -> None:
        """Note that the consumer has processed all edges up to ``seq``.

        One that was not delivered here is ignored: it is of a board that restarted
        since, and would acknowledge new edges unseen.
        """
        if self.expected is None or _signed(seq - self.expected) >= 0:
            return
        done = self._acknowledged
        if done is None or _signed(seq - done) > 0:
            self._acknowledged = seq


class StreamSequence:
    """Sequence numbers of one stream, 32 bits on the wire, unwrapped here."""

    def __init__(self) -> None:
        self._expected = 0

    def accept(
        self, seq: NDArray[np.uint32]
    ) -> tuple[Integers, Booleans | None, int, int]:
        """Judge the numbers (n,) of a block.

        Returns:
            The unwrapped numbers to be kept; a mask (n,) of them, None for all; how
            many are missing before or between; how many are repeated or impossible.
        """
        n = len(seq)
        numbers = np.arange(self._expected, self._expected + n)
        if (seq == numbers.astype(np.uint32)).all():
            self._expected += n
            return numbers, None, 0, 0
        ahead = (seq.astype(np.int64) - self._expected + WRAP // 2) % WRAP - WRAP // 2
        possible = np.abs(ahead) < MAX_JUMP
        reached = np.maximum.accumulate(np.where(possible, ahead, -1))
        before = np.concatenate(([-1], np.maximum(reached[:-1], -1)))
        kept = possible & (ahead > before)
        numbers = self._expected + ahead[kept]
        lost = self.reach(int(numbers[-1]) + 1) - len(numbers) if len(numbers) else 0
        return numbers, kept, lost, n - len(numbers)

    def reach(self, next_seq: int) -> int:
        """Take the board's next number; return how many were skipped."""
        ahead = _signed(next_seq - self._expected)
        if not 0 < ahead < MAX_JUMP:
            return 0
        self._expected += ahead
        return ahead


def _signed(difference: int) -> int:
    return (difference + WRAP // 2) % WRAP - WRAP // 2

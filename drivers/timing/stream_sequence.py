"""Follows the sequence numbers of a timed stream: what is new, lost, repeated."""

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Integers

WRAP = 1 << 32
MAX_JUMP = 1 << 20  # a hundred seconds at 10 kHz: no gap of a living stream


class StreamSequence:
    """Sequence numbers of one stream, 32 bits on the wire, unwrapped here."""

    def __init__(self) -> None:
        self._expected = 0

    def accept(
        self, seq: NDArray[np.uint32]
    ) -> tuple[Integers, Booleans | None, int, int]:
        """Judge the numbers (n,) of a block.

        Returns:
            The unwrapped numbers of what is to be kept; a mask (n,) of what that
            is, None for all; how many are missing before or between; how many are
            to be dropped because they are repeated, or impossible.
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
        """The board reports ``next_seq`` as next: how many were skipped."""
        ahead = (next_seq - self._expected + WRAP // 2) % WRAP - WRAP // 2
        if not 0 < ahead < MAX_JUMP:
            return 0
        self._expected += ahead
        return ahead

"""The timed stream: which ticks its samples are latched at."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Integers


@dataclass(slots=True)
class Stream:
    """A running stream; sample k is at first + round(k tick_rate 1000 / rate).

    Attributes:
        request: Of its START.
        rate_millihz: Requested.
        tick_rate_hz: Of the board.
        first_tick: Of sample 0.
        next_seq: Of the next sample, without wrap.
    """

    request: int
    rate_millihz: int
    tick_rate_hz: int
    first_tick: int
    next_seq: int = 0

    def next_tick(self) -> int:
        """Tick of the next sample."""
        return self.first_tick + self._offset(self.next_seq)

    def take_until(self, tick: int) -> tuple[Integers, Integers]:
        """Take the samples up to and including a tick.

        From round(k a / b) <= d follows k <= (b (2 d + 1) - 1) // (2 a).

        Returns:
            Sequence numbers and ticks (n,), both without wrap.
        """
        elapsed = tick - self.first_tick
        span = 1000 * self.tick_rate_hz
        last_seq = (self.rate_millihz * (2 * elapsed + 1) - 1) // (2 * span)
        first_seq = self.next_seq
        seqs = np.arange(first_seq, max(last_seq + 1, first_seq), dtype=np.int64)
        self.next_seq = first_seq + len(seqs)
        return seqs, self.first_tick + self._offsets(first_seq, len(seqs))

    def _offset(self, seq: int) -> int:
        return int(self._offsets(seq, 1)[0])

    def _offsets(self, first_seq: int, n_samples: int) -> Integers:
        # After rate_millihz samples exactly 1000 tick_rate_hz ticks have passed;
        # counting from there keeps the products below 2^63 for ever.
        span = 1000 * self.tick_rate_hz
        rounds, rest = divmod(first_seq, self.rate_millihz)
        seqs = rest + np.arange(n_samples, dtype=np.int64)
        twice = 2 * seqs * span + self.rate_millihz
        return rounds * span + twice // (2 * self.rate_millihz)

"""One polled encoder: last count, and validity of readings.

Check bits pass some bad words. A reading must therefore be within reach of the shaft
since the last good one; and the first one, also after an encoder was missing, is
accepted once the next confirms it.
"""

import math
from dataclasses import dataclass

READ_ERRORS_FOR_ALARM = 3
ASK_AGAIN_NS = 500_000_000  # vain requests cost the other encoders time
SLACK_NS = 1_000_000  # instants of readings are known to about an exchange
SLACK_COUNTS = 4


@dataclass(frozen=True, slots=True)
class EncoderReading:
    """A count and the host's monotonic time of its latch.

    Attributes:
        status: bits ``STATUS_*`` sent with it.
    """

    count: int
    time_ns: int
    status: int = 0


@dataclass(frozen=True, slots=True)
class ReadError:
    """A failed reading; ``code`` is also the name of its counter."""

    code: str
    text: str
    remedy: str


IMPLAUSIBLE = ReadError(
    "implausible",
    "has jumped further than a joint can turn in that time",
    "check cable and shielding, and whether max_speed_rad_s is too small",
)
UNCONFIRMED = ReadError("unconfirmed", "answers again", "")


class PolledChannel:
    """State of one encoder.

    Attributes:
        count: the last good one; 0 before the first.
        time_ns: of that; None before the first, and after it was missing.
        misses: successive failed readings.
    """

    def __init__(
        self, name: str, modulus: int, counts_per_turn: int, max_speed_rad_s: float
    ) -> None:
        self.name = name
        self.modulus = modulus
        self.counts_per_turn = counts_per_turn
        self.count = 0
        self.time_ns: int | None = None
        self.misses = 0
        self._counts_per_ns = max_speed_rad_s * counts_per_turn / math.tau * 1e-9
        self._unconfirmed: EncoderReading | None = None
        self._ask_again_ns = 0

    @property
    def missing(self) -> bool:
        """Whether it failed so often that it is polled only occasionally."""
        return self.misses >= READ_ERRORS_FOR_ALARM

    def due(self, now_ns: int) -> bool:
        """Return whether to poll it."""
        return not self.missing or now_ns >= self._ask_again_ns

    def accept(
        self, answer: EncoderReading | ReadError, now_ns: int
    ) -> ReadError | None:
        """Check a reply; None if it is valid."""
        if isinstance(answer, ReadError):
            return self._failed(answer, now_ns)
        if self.time_ns is not None:
            before: EncoderReading | None = EncoderReading(self.count, self.time_ns)
        else:
            before, self._unconfirmed = self._unconfirmed, answer
        if before is None:
            self._ask_again_ns = now_ns
            return UNCONFIRMED
        if not self._reachable(before, answer):
            return self._failed(IMPLAUSIBLE, now_ns)
        self.count, self.time_ns = answer.count, answer.time_ns
        self.misses = 0
        self._unconfirmed = None
        return None

    def reset(self) -> None:
        self.time_ns = self._unconfirmed = None

    def _failed(self, miss: ReadError, now_ns: int) -> ReadError:
        self.misses += 1
        if self.missing:
            self.reset()
            self._ask_again_ns = now_ns + ASK_AGAIN_NS
        return miss

    def _reachable(self, before: EncoderReading, after: EncoderReading) -> bool:
        half = self.modulus // 2
        steps = abs((after.count - before.count + half) % self.modulus - half)
        elapsed_ns = after.time_ns - before.time_ns + SLACK_NS
        return steps <= SLACK_COUNTS + elapsed_ns * self._counts_per_ns

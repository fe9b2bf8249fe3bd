"""One polled encoder: last count, and validity of readings.

Check bits pass some bad words. A reading out of the shaft's reach since the last good
one is therefore left out until the next one tells: a count that has jumped stays there,
which is for the daemon to see. The first one, also after an encoder was missing, is
accepted once the next confirms it.

Strategy: where no check sum protects readings, a spoilt one may be a place that the
shaft could have reached. A spoilt reading leaves the motion and the next one is back on
it; a shaft that is stopped stays where it is. So a reading off the motion so far is
left out, too. What is off by less than a hand's motion
explains passes; of a joint that rests that is little. Hence every sign of spoilt bytes
puts all readings of the next seconds in doubt: where one was spoilt visibly, others may
have been invisibly.
"""

import math
from dataclasses import dataclass

from traverse.drivers.base.values import STATUS_WARNING

READ_ERRORS_FOR_ALARM = 3
ASK_AGAIN_NS = 500_000_000  # vain requests cost the other encoders time
SLACK_NS = 1_000_000  # instants of readings are known to about an exchange
SLACK_COUNTS = 4
JUMP_SHARE = 0.25  # of the greatest speed, at which a joint is that has jumped
HAND_RAD_S2 = 50.0  # 4 g at 0.8 m; a wrist twists so
REST_COUNTS, REST_NS = 1, 25_000_000  # a joint rests that moved no more in that time
START_COUNTS = 3.0  # noise of a joint that rests, and what it had begun unseen
START_RAD_S3 = 2000.0  # no hand begins to move it more abruptly
MOTION_NS = 50_000_000  # readings further apart say nothing of each other's motion
DAMAGE_NS = 2_000_000_000  # so long readings are in doubt after a spoilt one


@dataclass(frozen=True, slots=True)
class EncoderReading:
    """A count and the host's monotonic time of its latch.

    Attributes:
        status: bits ``STATUS_*`` sent with it.
        bound_ns: how far the time may be off; 0: as the driver states for all.
    """

    count: int
    time_ns: int
    status: int = 0
    bound_ns: int = 0


@dataclass(frozen=True, slots=True)
class ReadError:
    """A failed reading.

    Attributes:
        code: also the name of its counter.
        is_damage: bytes have changed on their way; that some are lacking always shows.
    """

    code: str
    text: str
    remedy: str
    is_damage: bool = False


IMPLAUSIBLE = ReadError(
    "implausible",
    "has jumped further than a joint can turn in that time",
    "check cable and shielding, and whether max_speed_rad_s is too small",
    is_damage=True,
)
UNCONFIRMED = ReadError("unconfirmed", "answers again", "")


class PolledChannel:
    """State of one encoder.

    Attributes:
        is_checked: a check sum protects its readings.
        count: the last good one; 0 before the first.
        time_ns: of that; None before the first, and after it was missing.
        away_ns: since the good one before it, if it was missing meanwhile; else 0.
    """

    def __init__(
        self,
        name: str,
        modulus: int,
        counts_per_turn: int,
        max_speed_rad_s: float,
        *,
        is_checked: bool = True,
    ) -> None:
        self.name = name
        self.modulus = modulus
        self.counts_per_turn = counts_per_turn
        self.count = 0
        self.time_ns: int | None = None
        self.misses = self.away_ns = 0
        self._good_ns: int | None = None
        counts_per_rad = counts_per_turn / math.tau
        self._counts_per_ns = max_speed_rad_s * counts_per_rad * 1e-9
        self._counts_per_ns2 = HAND_RAD_S2 * counts_per_rad * 1e-18
        self._counts_per_ns3 = START_RAD_S3 * counts_per_rad * 1e-27
        self._unconfirmed: EncoderReading | None = None
        self._ask_again_ns = 0
        self.is_checked = is_checked
        self._earlier: EncoderReading | None = None  # the good one before the last
        self._resting: EncoderReading | None = None  # since when it has stayed there
        self._left_out: EncoderReading | None = None  # which the next one judges
        self._bound_ns = 0  # of the last time
        self._doubted_until_ns = 0

    @property
    def missing(self) -> bool:
        """Whether reads failed `READ_ERRORS_FOR_ALARM` times: it is polled rarely."""
        return self.misses >= READ_ERRORS_FOR_ALARM

    def due(self, now_ns: int) -> bool:
        return not self.missing or now_ns >= self._ask_again_ns

    def accept(
        self, answer: EncoderReading | ReadError, now_ns: int
    ) -> ReadError | None:
        """Check a reply; None if it is valid."""
        if isinstance(answer, ReadError):
            if answer.is_damage:
                self.doubt(now_ns)
            return self._failed(answer, now_ns)
        if self.time_ns is not None:
            before: EncoderReading | None = EncoderReading(
                self.count, self.time_ns, bound_ns=self._bound_ns
            )
        else:
            self._earlier = None
            before, self._unconfirmed = self._unconfirmed, answer
        if before is None:
            self._ask_again_ns = now_ns
            return UNCONFIRMED
        left_out, self._left_out = self._left_out, None
        if not self._reachable(before, answer):
            self.doubt(now_ns)
            if left_out is None or not self._agree(left_out, answer):
                self._left_out = answer
                return self._failed(IMPLAUSIBLE, now_ns)
            before, self._resting = left_out, None
        elif not self.is_checked:
            follows = self._follows(before, answer)
            if not follows and left_out is None:
                self._left_out = answer
                return self._failed(IMPLAUSIBLE, now_ns)
            if follows and left_out is not None:
                self.doubt(now_ns)
        self._earlier, resting = before, self._resting
        if resting is None or abs(self._steps(resting, answer)) > REST_COUNTS:
            self._resting = answer
        self.away_ns = 0
        if self.missing and self._good_ns is not None:
            self.away_ns = answer.time_ns - self._good_ns
        self.count = answer.count
        self.time_ns = self._good_ns = answer.time_ns
        self._bound_ns = answer.bound_ns
        self.misses = 0
        self._unconfirmed = None
        return None

    def unknown_rad(self, answer: EncoderReading) -> float:
        """Return how far the joint turns while an answer may have been read.

        A count is left out: noise may flip it at rest.
        """
        if self.time_ns is None or answer.time_ns <= self.time_ns:
            return 0.0
        steps = self._steps(EncoderReading(self.count, self.time_ns), answer)
        share = answer.bound_ns / (answer.time_ns - self.time_ns)
        return max(abs(steps) - 1, 0) * share * math.tau / self.counts_per_turn

    def doubt(self, now_ns: int) -> None:
        """Put readings in doubt for a while: bytes were spoilt, and others may be."""
        if not self.is_checked:
            self._doubted_until_ns = now_ns + DAMAGE_NS

    def status(self, now_ns: int) -> int:
        """Return the current marks of its readings, bits ``STATUS_*``."""
        return STATUS_WARNING if now_ns < self._doubted_until_ns else 0

    def reset(self) -> None:
        self.time_ns = self._unconfirmed = self._left_out = None

    def _failed(self, miss: ReadError, now_ns: int) -> ReadError:
        self.misses += 1
        if self.missing:
            self.reset()
            self._ask_again_ns = now_ns + ASK_AGAIN_NS
        return miss

    def _agree(self, before: EncoderReading, after: EncoderReading) -> bool:
        """Return whether readings elsewhere are a jump: spoilt ones differ."""
        passed_ns = after.time_ns - before.time_ns
        near_counts = SLACK_COUNTS + passed_ns * self._counts_per_ns * JUMP_SHARE
        return abs(self._steps(before, after)) <= near_counts

    def _reachable(self, before: EncoderReading, after: EncoderReading) -> bool:
        elapsed_ns = after.time_ns - before.time_ns + SLACK_NS
        return (
            abs(self._steps(before, after))
            <= SLACK_COUNTS + elapsed_ns * self._counts_per_ns
        )

    def _steps(self, before: EncoderReading, after: EncoderReading) -> int:
        half = self.modulus // 2
        return (after.count - before.count + half) % self.modulus - half

    def _follows(self, before: EncoderReading, after: EncoderReading) -> bool:
        """Return whether a reading continues the motion so far, as by a hand."""
        earlier = self._earlier
        if earlier is None:
            return True
        before_ns = before.time_ns - earlier.time_ns
        passed_ns = after.time_ns - before.time_ns
        rested_ns = before.time_ns - self._resting.time_ns if self._resting else 0
        if rested_ns >= REST_NS and passed_ns < MOTION_NS:
            start = START_COUNTS + self._counts_per_ns3 * passed_ns**3 / 6.0
            return abs(self._steps(before, after)) <= start
        # The times of three readings may each be off.
        off_ns = SLACK_NS + earlier.bound_ns + 2 * before.bound_ns + after.bound_ns
        if not (off_ns < before_ns < MOTION_NS and 0 < passed_ns < MOTION_NS):
            return True
        speed = self._steps(earlier, before) / before_ns
        most = (
            SLACK_COUNTS * (1.0 + passed_ns / before_ns)
            + abs(speed) * off_ns * (1.0 + passed_ns / before_ns)
            + self._counts_per_ns2 * passed_ns * (before_ns + passed_ns) / 2.0
        )
        return abs(self._steps(before, after) - speed * passed_ns) <= most

"""Whether the daemon was at work at all: a crash test of a daemon that is down is none.

A run of 200 kills once ended well with 7 sessions in 229 starts: for most of it the
daemon had no board, so there was nothing that could be lost.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

QUIET_S = 2.0  # presses come about every 0.4 s
LEAST_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Span:
    """While programs and networks were killed.

    Attributes:
        begun_s: UTC, as are all times of the logs.
        ended_s: likewise.
        starts: of the daemon.
    """

    begun_s: float
    ended_s: float
    starts: int


@dataclass(frozen=True, slots=True)
class Work:
    """What the daemon did while programs and networks were killed.

    Attributes:
        seconds: how long that lasted.
        measuring_s: of these with edges acknowledged, a pause of two seconds at most.
        starts: of the daemon.
        sessions: with at least one point in the outbox.
    """

    seconds: float
    measuring_s: float
    starts: int
    sessions: int

    @property
    def share(self) -> float:
        """Of the time in which it was measuring, 0 to 1."""
        return self.measuring_s / self.seconds if self.seconds > 0.0 else 0.0

    def faults(self) -> list[str]:
        """Why the run shows too little, in sentences; empty where it shows enough."""
        said = []
        if self.share < LEAST_SHARE:
            said.append(
                f"the daemon was measuring for {self.share:.0%} of {self.seconds:.0f} "
                f"s, at least {LEAST_SHARE:.0%} is needed to show anything; run again "
                "with --folder and see daemon.log, tap.log and board.log there"
            )
        if self.sessions < LEAST_SHARE * self.starts:
            said.append(
                f"{self.sessions} sessions with points in {self.starts} starts of the "
                f"daemon, at least {LEAST_SHARE:.0%} of them are needed to show "
                "anything; run again with --folder and see why in daemon.log there"
            )
        return said


def measuring_s(times_s: Iterable[float], begun_s: float, ended_s: float) -> float:
    """How long edges were acknowledged between two instants, without the pauses.

    Args:
        times_s: when edges were acknowledged, in order.
        begun_s: first instant that counts.
        ended_s: last instant that counts.
    """
    within = [begun_s - 2 * QUIET_S]
    within += [time_s for time_s in times_s if begun_s <= time_s <= ended_s]
    return sum(b - a for a, b in pairwise(within) if b - a <= QUIET_S)

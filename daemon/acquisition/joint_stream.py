"""One device that reads joints, and what its readings say about any instant."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.acquisition.interpolation import (
    Integers,
    Limits,
    are_valid,
    brought,
)
from traverse.daemon.acquisition.reading_buffer import History
from traverse.drivers.base.values import CountSamples, LatchedCounts

MAX_GAP_PERIODS = 3  # readings further apart than so many periods have lost others


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """What k joints showed at n instants.

    Attributes:
        counts: (n, k) int64; whole turns are of no meaning.
        fractions: (n, k). status: (n, k) uint8.
        error_bounds_counts: (n, k, 2), see
            `traverse.daemon.acquisition.interpolation.Interpolated`.
    """

    counts: Integers
    fractions: NDArray[np.float64]
    status: NDArray[np.uint8]
    error_bounds_counts: NDArray[np.float64]


class JointStream:
    """Follows the joints on one device.

    Args:
        joints: which of the arm, (k,).
        channels: on which channels of the device, (k,).
        counts_per_turn: of each, (k,).
        wait_ns: how long readings are waited for.

    Attributes:
        history: its readings.
        period_ns: of its stream; 0 while unknown.
        jitter_ns: how far the instants of readings may be off.
        lost: nothing is to be waited for.
    """

    def __init__(
        self,
        joints: NDArray[np.intp],
        channels: NDArray[np.intp],
        counts_per_turn: Integers,
        wait_ns: int,
    ) -> None:
        self.joints = joints
        self.history = History(channels, counts_per_turn)
        self.period_ns = 0
        self.jitter_ns = 0
        self.lost = False
        self._channels = channels
        self._wait_ns = wait_ns

    def latched(self, latch: LatchedCounts) -> Columns:
        """What the device latched, one instant."""
        counts = np.array([latch.counts], np.int64)[:, self._channels]
        status = np.array([latch.status], np.uint8)[:, self._channels]
        return _exact(counts, status)

    def own(self, block: CountSamples) -> Columns:
        """What the device's own samples say about their instants."""
        status = block.status[:, self._channels]
        if block.skew_ns is None and are_valid(status).all():
            # What `at` would find, at once.
            return _exact(block.counts[:, self._channels].astype(np.int64), status)
        return self.at(block.sample_time_ns)

    def at(self, instants_ns: Integers) -> Columns:
        """What the readings say about any instants (n,)."""
        max_gap_ns = max(MAX_GAP_PERIODS * self.period_ns, self._wait_ns)
        limits = Limits(max_gap_ns, 0 if self.lost else self._wait_ns, self.jitter_ns)
        around = self.history.around(int(instants_ns[0]), max_gap_ns)
        found = [brought(readings, instants_ns, limits) for readings in around]
        return Columns(
            np.stack([one.counts for one in found], axis=1),
            np.stack([one.fractions for one in found], axis=1),
            np.stack([one.status for one in found], axis=1),
            np.stack([one.error_bounds_counts for one in found], axis=1),
        )


def _exact(counts: Integers, status: NDArray[np.uint8]) -> Columns:
    return Columns(counts, np.zeros(counts.shape), status, np.zeros((*counts.shape, 2)))

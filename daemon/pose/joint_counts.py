"""Counts of all joints at one instant, as the pipeline takes them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.drivers.base.values import CountSamples


@dataclass(frozen=True, slots=True, eq=False)
class JointCounts:
    """One instant.

    Attributes:
        sample_time_ns: host monotonic time.
        counts: (n_joints,) uint32, each within its turn.
        status: (n_joints,) uint8.
        fractions: (n_joints,) to be added to the counts; None for 0.
    """

    sample_time_ns: int
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]
    fractions: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ResampledBlock:
    """Samples of the whole arm.

    Attributes:
        samples: their channels are the joints, brought to common instants.
        error_bounds_counts: (n, n_joints, 2) how far each count may be off for
            that, see `Interpolated`.
    """

    samples: CountSamples
    error_bounds_counts: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ResampledCounts:
    """One instant of the whole arm, as `ResampledBlock`; doubts (n_joints, 2)."""

    counts: JointCounts
    error_bounds_counts: NDArray[np.float64]

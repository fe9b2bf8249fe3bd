"""Progress of an adjustment."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, eq=False)
class Iteration:
    """Progress of an adjustment.

    Attributes:
        number: From 1.
        sum_of_squares: Weighted, before the step.
        rms_mm: Root mean square of all scalar misclosures, before the step.
        step: Length of the whitened step, in standard deviations.
        fraction: Of the step that was taken.
        n_determined: Directions of the arm's parameters that count.
    """

    number: int
    sum_of_squares: float
    rms_mm: float
    step: float
    fraction: float
    n_determined: int


Progress = Callable[[Iteration], None]

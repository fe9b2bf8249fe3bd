"""Progress of an adjustment, and the covariance that it ends with, as a file."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats
from traverse.strict_toml.files import bytes_of


@dataclass(frozen=True, slots=True, eq=False)
class CartesianCovariance:
    """Covariance free of any basis, for `arm.cov.npz`.

    Attributes:
        names: `J1.axis.x`, ..., `J1.link.x`, ..., `probe.vector.x`, ..., the effects',
            `origin.x`, ...
        values: As estimated, (n_names,).
        covariance: Singular where something is held, (n_names, n_names).
    """

    names: tuple[str, ...]
    values: Floats
    covariance: Floats


COVARIANCE_FILE = "arm.cov.npz"


def write_covariance(cartesian: CartesianCovariance, path: Path) -> str:
    """Write names, values and covariance; return the file's SHA-256."""
    np.savez(
        path,
        names=np.array(cartesian.names),
        values=cartesian.values,
        covariance=cartesian.covariance,
    )
    return hashlib.sha256(bytes_of(path)).hexdigest()


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

"""The covariance of an arm over the components of its arm file, and its file."""

import hashlib
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

"""Choice of the kernel: NumPy, or C in a variant that runs here.

Chosen at import: the fastest, or the one that TRAVERSE_KERNEL names. All variants in C
give the same bits; NumPy's last digits differ from theirs.
"""

import os
from functools import lru_cache

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry

try:
    from traverse.kinematics.kernel.compiled import (
        LARGEST_N_JOINTS,
        Chain,
        DeflectedChain,  # noqa: F401 (a kernel built before it was there is not one)
        runnable_variants,
    )
except ImportError:  # not built: no compiler, or no Cython
    _RUNNABLE: tuple[str, ...] = ()
else:
    _RUNNABLE = runnable_variants()

VARIABLE = "TRAVERSE_KERNEL"
# In rising order of speed.
KERNELS = ("numpy", *_RUNNABLE)


def chosen_kernel(requested: str | None, kernels: tuple[str, ...]) -> str:
    """Choose the last of kernels in rising order of speed, or the requested one.

    Raises:
        ValueError: the requested kernel does not run here.
    """
    if not requested:
        return kernels[-1]
    if requested not in kernels:
        raise ValueError(
            f"{VARIABLE} is {requested!r}, which does not run here; expected one of "
            f"{', '.join(kernels)}, or nothing for the fastest"
        )
    return requested


KERNEL = chosen_kernel(os.environ.get(VARIABLE), KERNELS)


def compiled_chain(geometry: Geometry) -> "Chain | None":
    """Return the arm for the kernel in C; None if NumPy is to compute."""
    if KERNEL == "numpy" or len(geometry.axes) > LARGEST_N_JOINTS:
        return None
    return _chain(geometry)


def aligned_floats(angles_rad: Floats) -> Floats:
    """Return float64 values for the kernel, copied only if needed."""
    floats = np.asarray(angles_rad, dtype=np.float64)
    return floats if floats.flags.aligned else floats.copy()


def checked_readings(geometry: Geometry, angles_rad: Floats) -> Floats:
    """Return the readings of hinges as the kernel takes them.

    Raises:
        ValueError: they are not of shape (n_samples, n_joints).
    """
    expected = geometry.n_joints
    if angles_rad.ndim != 2 or angles_rad.shape[1] != expected:
        raise ValueError(
            f"angles_rad has shape {angles_rad.shape}, expected (n_samples, "
            f"{expected}): one column a joint of the arm"
        )
    return aligned_floats(geometry.hinge_readings(angles_rad))


# A geometry never changes, and most calls are for the same one.
@lru_cache(maxsize=8)
def _chain(geometry: Geometry) -> "Chain":
    return Chain(geometry, KERNEL)

"""Room for what the geometry leaves over: additional columns of the adjustment."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from kinematics.derivatives import ProbeDerivatives
from kinematics.geometry import Geometry
from lab.campaign import Poses

Floats = NDArray[np.float64]


class ProbeTerm(Protocol):
    """A few parameters that shift the ball's centre linearly: x += columns values.

    Effects are small, so how their columns depend on the geometry's corrections is
    left out of the derivatives.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, for example `J3.encoder_eccentricity.cos`."""

    @property
    def units(self) -> tuple[str, ...]:
        """Of the parameters."""

    @property
    def tolerances(self) -> tuple[float, ...]:
        """Plausible amplitudes: one known worse than that is undetermined."""

    def columns(
        self, geometry: Geometry, derivatives: ProbeDerivatives, poses: Poses
    ) -> Floats:
        """Compute the derivatives of x, (n_poses, 3, n_parameters)."""

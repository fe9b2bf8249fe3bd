"""The least-squares sphere of touches on a test sphere, beside the calibrated one."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits import Sphere, fit_sphere, fit_sphere_of_radius
from traverse.lab.artefacts.sphere import Sphere as TestSphere
from traverse.lab.measured_points.certified_values import IncompleteError, growth
from traverse.lab.measured_points.measurement import ArtefactTouches


@dataclass(frozen=True, slots=True)
class FittedSphere:
    """What touches say of a calibrated sphere.

    Attributes:
        centre_mm: (3,)
        size_mm: Diameter less the calibrated one, which has grown with the warmth.
        off_mm: (n,) How far each touch lies outside of the fitted sphere.
        form_mm: Largest distance from the centre less the smallest.
    """

    centre_mm: Floats
    size_mm: float
    off_mm: Floats
    form_mm: float


def fitted(
    touched: ArtefactTouches, what: str, radius_mm: float | None = None
) -> Sphere:
    """Fit a sphere to the places of the ball's centre.

    Raises:
        IncompleteError: The points fit no sphere.
    """
    try:
        if radius_mm is None:
            return fit_sphere(touched.places_mm)
        return fit_sphere_of_radius(touched.places_mm, radius_mm)
    except ValueError as error:
        raise IncompleteError(f"{what}: {error}") from error


def fitted_sphere(
    sphere: TestSphere, touched: ArtefactTouches, what: str
) -> FittedSphere:
    """Fit the touches of a calibrated sphere.

    Raises:
        IncompleteError: They fit no sphere, or nobody knows how warm it was.
    """
    found = fitted(touched, what)
    calibrated_mm = 2.0 * float(sphere.radius_mm or 0.0) * growth(sphere, touched)
    size_mm = 2.0 * (found.radius_mm - float(touched.tip_mm.mean())) - calibrated_mm
    away_mm = np.linalg.norm(touched.places_mm - found.centre_mm, axis=1)
    return FittedSphere(
        found.centre_mm, size_mm, away_mm - found.radius_mm, float(np.ptp(away_mm))
    )

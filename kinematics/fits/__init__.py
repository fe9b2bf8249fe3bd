"""Fits of measured points: shapes by least squares, and smallest spheres.

Distances are orthogonal. Uncertainties: `traverse.kinematics.fits.shapes`.
"""

from traverse.kinematics.fits.enclosing import (
    EnclosingSphere,
    Spread,
    enclosing_sphere,
    spread_about_mean,
)
from traverse.kinematics.fits.plausible import PLAUSIBLE_MM, off_seat, off_sphere
from traverse.kinematics.fits.shapes import (
    Plane,
    Sphere,
    fit_plane,
    fit_sphere,
    fit_sphere_of_radius,
)

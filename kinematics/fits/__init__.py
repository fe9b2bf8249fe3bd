"""Fits of measured points: shapes by least squares, and the smallest sphere around.

Distances are orthogonal: those of the points from the shape. Every shape says how well
it is known, see `traverse.kinematics.fits.adjustment`.
"""

from traverse.kinematics.fits.enclosing import (
    EnclosingSphere,
    Spread,
    enclosing_sphere,
    spread_about_mean,
)
from traverse.kinematics.fits.plane import Plane, fit_plane
from traverse.kinematics.fits.plausible import PLAUSIBLE_MM, off_seat, off_sphere
from traverse.kinematics.fits.sphere import Sphere, fit_sphere, fit_sphere_of_radius

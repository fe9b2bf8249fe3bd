"""Fits of measured points: shapes by least squares, and the smallest sphere around.

Distances are orthogonal: those of the points from the shape. Every shape says how well
it is known, see `traverse.kinematics.fits.adjustment`.
"""

from traverse.kinematics.fits.circle import Circle, fit_circle
from traverse.kinematics.fits.cylinder import Cylinder, fit_cylinder
from traverse.kinematics.fits.enclosing import EnclosingSphere, enclosing_sphere
from traverse.kinematics.fits.line import Line, fit_line
from traverse.kinematics.fits.plane import Plane, fit_plane
from traverse.kinematics.fits.plausible import PLAUSIBLE_MM, off_seat, off_sphere
from traverse.kinematics.fits.sphere import Sphere, fit_sphere, fit_sphere_of_radius
from traverse.kinematics.fits.spread import Spread, spread_about_mean

__all__ = [
    "PLAUSIBLE_MM",
    "Circle",
    "Cylinder",
    "EnclosingSphere",
    "Line",
    "Plane",
    "Sphere",
    "Spread",
    "enclosing_sphere",
    "fit_circle",
    "fit_cylinder",
    "fit_line",
    "fit_plane",
    "fit_sphere",
    "fit_sphere_of_radius",
    "off_seat",
    "off_sphere",
    "spread_about_mean",
]

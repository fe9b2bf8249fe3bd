"""Cylinders and cones through points.

They need a start near the solution. Strategy: directions spread over a hemisphere, 14
degrees apart, and the principal axes; with the axis given, an algebraic fit is linear;
the best few are adjusted, and the least sum of squares counts.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.elements import (
    ANGLE,
    DIRECTION,
    LEAST_POINTS,
    N_VALUES,
    PLACE,
    RADIUS,
    Element,
    Kind,
    element_values,
    fitted_element,
    positive_radius,
)
from traverse.kinematics.fits.shapes import Cloud, adjusted, cloud_of, turned_positive
from traverse.kinematics.model.geometry import across

_N_DIRECTIONS, _N_STARTS = 120, 4
_FLATTEST_RAD, _STEEPEST_RAD = 1e-3, 1.5


def cylinder_element(points_mm: Floats, offset_mm: float = 0.0) -> Element:
    """Fit a cylinder to balls' centres; the surface is `offset_mm` further out."""
    return _axial_element("cylinder", points_mm, offset_mm)


def cone_element(points_mm: Floats, offset_mm: float = 0.0) -> Element:
    """Fit a cone to balls' centres; the surface is `offset_mm` further out.

    The direction leads away from the apex; the radius is across the axis at the place,
    which is beside the points' mean.
    """
    return _axial_element("cone", points_mm, offset_mm)


@dataclass(frozen=True, slots=True, eq=False)
class _Axial:
    """A cylinder (half angle 0) or a cone, its radius at the place."""

    place: Floats
    direction: Floats
    radius: float
    angle: float

    def distances(self, points: Floats) -> tuple[Floats, Floats, Floats]:
        """Return distances, their normals and their derivatives by six freedoms.

        With u = x - c, h = u . a, rho = |u - h a|, e = (u - h a) / rho:
        d = (rho - r) cos(psi) - h sin(psi), n = e cos(psi) - a sin(psi).
        Freedoms: the place across the axis, the axis, the radius, the half angle.
        """
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        from_place = points - self.place
        heights = from_place @ self.direction
        radial = from_place - heights[:, np.newaxis] * self.direction
        lengths = np.linalg.norm(radial, axis=1)
        if not np.all(lengths > 0.0):
            raise ValueError("a point lies on the axis; leave it out")
        radial /= lengths[:, np.newaxis]
        excess = lengths - self.radius
        basis = np.stack(across(self.direction), axis=1)
        levers = heights * cosine + lengths * sine
        sides = radial @ basis
        design = np.column_stack(
            [
                cosine * sides,
                levers[:, np.newaxis] * sides,
                np.full(len(points), cosine),
                excess * sine + heights * cosine,
            ]
        )
        normals = cosine * radial - sine * self.direction
        return excess * cosine - heights * sine, normals, design

    def moved(self, step: Floats) -> "_Axial":
        basis = np.stack(across(self.direction), axis=1)
        direction = self.direction + basis @ step[2:4]
        angle = self.angle + (float(step[5]) if len(step) > 5 else 0.0)
        return _Axial(
            self.place + basis @ step[:2],
            direction / np.linalg.norm(direction),
            self.radius + float(step[4]),
            angle,
        )


def _axial_element(
    kind: Literal["cylinder", "cone"], points_mm: Floats, offset_mm: float
) -> Element:
    cloud = cloud_of(points_mm, LEAST_POINTS[kind])
    cloud.refuse_degenerate(kind, flat=True)
    n_freedoms = 5 if kind == "cylinder" else 6

    def linearised(state: _Axial) -> tuple[Floats, Floats]:
        distances, _, design = state.distances(cloud.points)
        return distances, -design[:, :n_freedoms]

    best: tuple[float, _Axial] | None = None
    trouble = ValueError(f"the points do not look like a {kind}")
    for start in _axial_starts(cloud, with_angle=kind == "cone"):
        try:
            state, distances, _ = adjusted(start, linearised, _Axial.moved, kind)
        except ValueError as error:
            trouble = error
            continue
        squares = float(distances @ distances)
        if best is None or squares < best[0]:
            best = squares, state
    if best is None:
        raise trouble
    return _axial_with_derivatives(kind, cloud, best[1], offset_mm, n_freedoms)


def _axial_with_derivatives(
    kind: Kind, cloud: Cloud, fitted: _Axial, offset_mm: float, n_freedoms: int
) -> Element:
    direction, angle, radius = fitted.direction, fitted.angle, fitted.radius
    if radius < 0.0:  # beyond the apex: the other nappe
        radius, angle = -radius, -angle
    direction = turned_positive(direction) if kind == "cylinder" else direction
    if angle < 0.0:
        direction, angle = -direction, -angle
    if kind == "cone" and not _FLATTEST_RAD < angle < _STEEPEST_RAD:
        raise ValueError(
            f"the half angle of the cone is {np.rad2deg(angle):.3g} degrees; measure a "
            f"{'plane' if angle > 1.0 else 'cylinder'} instead"
        )
    # The place beside the mean of the points, and the radius there.
    place = fitted.place - direction * float(fitted.place @ direction)
    radius += np.tan(angle) * float((place - fitted.place) @ direction)
    size_mm = cloud.extent_mm
    at_mm = _Axial(size_mm * place, direction, size_mm * float(radius), angle)
    local_mm = size_mm * cloud.points
    distances_mm, normals, design = at_mm.distances(local_mm)
    by_freedoms = np.zeros((N_VALUES, n_freedoms))
    first, second = across(direction)
    by_freedoms[PLACE, 0], by_freedoms[PLACE, 1] = first, second
    by_freedoms[DIRECTION, 2], by_freedoms[DIRECTION, 3] = first, second
    by_freedoms[RADIUS, 4] = 1.0
    cosine = np.cos(angle)
    if n_freedoms > 5:
        by_freedoms[RADIUS, 5] = offset_mm * np.sin(angle) / cosine**2
        by_freedoms[ANGLE, 5] = 1.0
    surface_mm = at_mm.radius + offset_mm / float(cosine)
    return fitted_element(
        kind,
        element_values(
            cloud.mean_mm + at_mm.place, direction, positive_radius(surface_mm), angle
        ),
        by_freedoms,
        local_mm,
        (distances_mm, normals, design[:, :n_freedoms]),
    )


def _axial_starts(cloud: Cloud, *, with_angle: bool) -> list[_Axial]:
    """Return the best starts, by their algebraic fits with a given axis.

    x^2 + y^2 = 2 a x + 2 b y + k_0 + k_1 h + k_2 h^2 is linear for each direction.
    """
    number = np.arange(_N_DIRECTIONS)
    heights = 1.0 - (number + 0.5) / _N_DIRECTIONS  # a spiral over a hemisphere
    turns = number * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1.0 - heights**2)
    spread = np.column_stack([flat * np.cos(turns), flat * np.sin(turns), heights])
    directions = np.concatenate([cloud.axes, spread])
    bases = np.array([np.stack(across(d), axis=1) for d in directions])
    xy = cloud.points @ bases  # (n_directions, n_points, 2)
    along = (cloud.points @ directions.T).T[:, :, np.newaxis]
    columns = [2.0 * xy, np.ones_like(along)]
    if with_angle:
        columns += [along, along**2]
    design, squares = np.concatenate(columns, axis=2), np.sum(xy**2, axis=2)
    solutions = np.einsum("dqn,dn->dq", np.linalg.pinv(design), squares)
    rated: list[tuple[float, int, _Axial]] = []
    for direction, basis, solution in zip(directions, bases, solutions, strict=True):
        radius2 = float(solution[2] + solution[:2] @ solution[:2])
        if not radius2 > 0.0:
            continue
        radius, angle = float(np.sqrt(radius2)), 0.0
        if with_angle:  # (r + h tan psi)^2 = r^2 + 2 r tan psi h + ...
            angle = float(np.arctan(solution[3] / (2.0 * radius)))
        start = _Axial(basis @ solution[:2], direction, radius, angle)
        distances, _, _ = start.distances(cloud.points)
        rated.append((float(distances @ distances), len(rated), start))
    return [start for _, _, start in sorted(rated)[:_N_STARTS]]

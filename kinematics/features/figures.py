"""Figures of features, their uncertainty, and conformity with a tolerance.

Lengths and angles near zero are not linear in their errors. With a vector v of the
covariance V and its direction n,

    u^2(|v|) = n^T V n + min(b, s)^2,    s^2 = tr V - n^T V n,    b = s^2 / 2|v|,

b being how much longer the errors across v make it: nothing of a long vector, and all
of tr V where it vanishes. Likewise of angles, where b = s^2 / (2 tan alpha).

The form deviation grows by the noise of its n points, by at most 2 sqrt(2 ln n) of
their standard deviations and never by more than itself; half of that is added to its
standard uncertainty likewise. Two of its points make it: what each of them has for
itself counts once, also of samples of a scan.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.features.relations import SHAPES, Numbers, derivatives
from traverse.kinematics.fits.elements import (
    ANGLE,
    DIRECTION,
    PLACE,
    RADIUS,
    Element,
    Fit,
)
from traverse.kinematics.model.geometry import across
from traverse.kinematics.uncertainty.joint_covariance import (
    COVERAGE_FACTOR,
    JointCovariance,
)

Conformity = Literal["conforming", "not conforming", "undecided", "not judged"]
Difference = Callable[[Numbers, Numbers], Numbers]
_REFERENCE_C = 20.0
_PARALLEL_RAD = np.deg2rad(1.0)  # lines below: distance beside the first's place


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure of a feature, or of two.

    Attributes:
        value: in mm, angles in rad.
        std: standard uncertainty, in the same unit.
        is_angle: whether it is an angle.
    """

    name: str
    value: float
    std: float
    is_angle: bool = False

    @property
    def expanded(self) -> float:
        """U, k = 2."""
        return COVERAGE_FACTOR * self.std


@dataclass(frozen=True, slots=True)
class Expansion:
    """Temperature of a part, from which its lengths are stated at 20 °C (ISO 1)."""

    temperature_c: float
    temperature_std_c: float
    expansion_per_c: float
    expansion_std_per_c: float

    @property
    def length(self) -> float:
        """A length now over the length at 20 °C."""
        return 1.0 + self.expansion_per_c * (self.temperature_c - _REFERENCE_C)

    def at_reference(self, figure: Figure) -> Figure:
        """Return a length as it is at 20 °C; an angle as it is."""
        if figure.is_angle:
            return figure
        warm_c = self.temperature_c - _REFERENCE_C
        share_std = np.hypot(
            self.expansion_per_c * self.temperature_std_c,
            self.expansion_std_per_c * np.hypot(warm_c, self.temperature_std_c),
        )
        value, std = figure.value / self.length, figure.std / self.length
        return replace(figure, value=value, std=float(np.hypot(std, value * share_std)))


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Limits of a figure, in its unit: nominal + lower to nominal + upper."""

    nominal: float
    lower: float
    upper: float

    def conformity(self, figure: Figure) -> Conformity:
        """Decide by ISO 14253-1: nothing is proved within U of a limit."""
        above = figure.value - (self.nominal + self.lower)
        below = self.nominal + self.upper - figure.value
        room = min(above, below)
        if room >= figure.expanded:
            return "conforming"
        return "not conforming" if room < -figure.expanded else "undecided"


def figures_of(element: Element, errors: JointCovariance) -> list[Figure]:
    """Return the figures of an element: place, size, form, as far as it has them."""
    figures = []
    if SHAPES[element.kind] == "point":
        figures += [
            _linear("xyz"[axis], element.values[axis], element.by_points[axis], errors)
            for axis in range(3)
        ]
    if element.kind in ("circle", "sphere", "cylinder"):
        diameter_mm = 2.0 * element.values[RADIUS]
        by_points = 2.0 * element.by_points[RADIUS]
        figures.append(_linear("diameter", diameter_mm, by_points, errors))
    if element.kind == "cone":
        angle, by_points = 2.0 * element.values[ANGLE], 2.0 * element.by_points[ANGLE]
        figures.append(_linear("angle", angle, by_points, errors, is_angle=True))
    if element.fit is not None and element.fit.redundancy > 0:
        figures.append(_form(element.fit, errors))
    return figures


def distance(first: Element, second: Element, errors: JointCovariance) -> Figure:
    """Compute the distance of two elements.

    Of points (centres), of a point from an axis or a plane; of a plane, or of an axis
    from a plane, beside the middle of the touches of the second; of two axes the
    shortest, and of parallel ones the distance of the first's middle from the second.
    """
    order = ("plane", "line", "point")
    if order.index(SHAPES[first.kind]) < order.index(SHAPES[second.kind]):
        first, second = second, first
    shapes = SHAPES[first.kind], SHAPES[second.kind]
    function: Difference = _from_point
    if shapes[1] == "plane":
        function = _from_plane
    elif shapes == ("line", "line"):
        sine = np.linalg.norm(np.cross(first.direction, second.direction))
        function = _from_line if sine < np.sin(_PARALLEL_RAD) else _between_lines
    elif shapes[1] == "line":
        function = _from_line
    vector_mm, by_points = _between(function, first, second)
    return _length("distance", vector_mm, by_points, errors)


def angle(first: Element, second: Element, errors: JointCovariance) -> Figure:
    """Compute the angle of two directions, 0 to 90 degrees.

    Axes, normals of planes and circles; of an axis and a plane the angle to the plane.

    Raises:
        ValueError: one has no direction.
    """
    directions = []
    for element in (first, second):
        if not element.direction.any():
            raise ValueError(f"a {element.kind} has no direction")
        directions.append(element.direction)
    axis, other_axis = directions
    sense = 1.0 if axis @ other_axis >= 0.0 else -1.0
    other_axis = sense * other_axis
    normal = np.cross(axis, other_axis)
    sine = float(np.linalg.norm(normal))
    value = float(np.arctan2(sine, axis @ other_axis))
    beside = normal / sine if sine > 0.0 else across(axis)[0]
    turns = np.einsum(
        "ki,inj->knj",
        np.stack([np.cross(beside, other_axis), beside]),
        sense * second.by_points[DIRECTION],
    ) - np.einsum(
        "ki,inj->knj",
        np.stack([np.cross(beside, axis), beside]),
        first.by_points[DIRECTION],
    )
    covariance, _ = errors.combined(turns)
    across_std = float(np.sqrt(max(covariance[1, 1], 0.0)))
    tangent = np.tan(value)
    grown = across_std**2 / (2.0 * tangent) if tangent > 0.0 else np.inf
    std = np.sqrt(max(covariance[0, 0], 0.0) + min(grown, across_std) ** 2)
    is_to_plane = (first.kind == "plane") != (second.kind == "plane")
    if is_to_plane:
        value = np.pi / 2.0 - value
    return Figure("angle", float(value), float(std), is_angle=True)


def _linear(
    name: str,
    value: float,
    by_points: Floats,
    errors: JointCovariance,
    *,
    is_angle: bool = False,
) -> Figure:
    covariance, _ = errors.combined(by_points[np.newaxis])
    std = float(np.sqrt(max(float(covariance[0, 0]), 0.0)))
    return Figure(name, float(value), std, is_angle)


def _form(fit: Fit, errors: JointCovariance) -> Figure:
    repeated = (1.0 - 1.0 / fit.repeats)[:, np.newaxis, np.newaxis]
    covariances_mm2 = errors.covariances_mm2.copy()
    covariances_mm2[fit.rows] -= repeated * errors.own_mm2[fit.rows]
    errors = replace(errors, covariances_mm2=covariances_mm2)
    weights = fit.form @ fit.residual_projector
    by_points = np.zeros_like(errors.points_mm)
    np.add.at(by_points, fit.rows, weights[:, np.newaxis] * fit.normals)
    form_mm = float(fit.form @ fit.distances_mm)
    figure = _linear("form", form_mm, by_points, errors)
    variances_mm2 = np.einsum(
        "ia,iab,ib->i", fit.normals, errors.own_mm2[fit.rows], fit.normals
    )
    noise_mm = float(np.sqrt(max(float(variances_mm2.mean()), 0.0)))
    grown_mm = min(2.0 * np.sqrt(2.0 * np.log(len(fit.rows))) * noise_mm, form_mm)
    return Figure("form", form_mm, float(np.hypot(figure.std, grown_mm / 2.0)))


def _length(
    name: str, vector_mm: Floats, by_points: Floats, errors: JointCovariance
) -> Figure:
    covariance, _ = errors.combined(by_points)
    length_mm = float(np.linalg.norm(vector_mm))
    total = float(np.trace(covariance))
    direction = vector_mm / length_mm if length_mm > 0.0 else np.zeros(len(vector_mm))
    along = float(direction @ covariance @ direction)
    across_mm2 = max(total - along, 0.0)
    grown_mm = across_mm2 / (2.0 * length_mm) if length_mm > 0.0 else np.inf
    variance_mm2 = max(along, 0.0) + min(grown_mm, np.sqrt(across_mm2)) ** 2
    return Figure(name, length_mm, float(np.sqrt(variance_mm2)))


def _between(
    function: Difference, first: Element, second: Element
) -> tuple[Floats, Floats]:
    vector_mm, (by_first, by_second) = derivatives(
        function, first.values, second.values
    )
    by_points = np.einsum("qp,pni->qni", by_first, first.by_points)
    by_points += np.einsum("qp,pni->qni", by_second, second.by_points)
    return vector_mm, by_points


def _from_point(first: Numbers, second: Numbers) -> Numbers:
    way: Numbers = second[PLACE] - first[PLACE]
    return way


def _from_line(first: Numbers, line: Numbers) -> Numbers:
    way = first[PLACE] - line[PLACE]
    beside: Numbers = way - line[DIRECTION] * (way @ line[DIRECTION])
    return beside


def _from_plane(first: Numbers, plane: Numbers) -> Numbers:
    return np.atleast_1d(plane[DIRECTION] @ (first[PLACE] - plane[PLACE]))


def _between_lines(first: Numbers, second: Numbers) -> Numbers:
    normal = np.cross(first[DIRECTION], second[DIRECTION])
    way = normal @ (second[PLACE] - first[PLACE])
    return np.atleast_1d(way / np.sqrt(normal @ normal))

"""Elements of parts through touched points, by least squares, with their derivatives.

An element is q = (place, direction, radius, half angle), eight numbers of which each
kind uses some. The sum of squares of orthogonal distances d is least (ISO 10360-6): to
first order, with n_i the normal of the element at point i and A = dd/df for its
freedoms f,

    n_i . dx_i = A_i df,    so    dq = (dq/df) A^+ (n . dx) = sum over i of W_i dx_i.

Points are centres of the ball, and the fitted element lies beside the surface by its
radius. Surface elements are `offset` along the normal: outwards of a hole that was
touched from inside, inwards of a shaft.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.fits.shapes import (
    checked_points,
    cloud_of,
    fit_plane,
    fit_sphere,
    inverse_normal,
    turned_positive,
)
from traverse.kinematics.model.geometry import across

Kind = Literal["point", "line", "plane", "circle", "sphere", "cylinder", "cone"]
PLACE, DIRECTION, RADIUS, ANGLE = slice(0, 3), slice(3, 6), 6, 7
N_VALUES = 8
LEAST_POINTS: dict[Kind, int] = {
    "point": 1,
    "line": 2,
    "plane": 3,
    "circle": 3,
    "sphere": 4,
    "cylinder": 6,  # five lie on up to six cylinders
    "cone": 7,  # six lie on several cones
}


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Distances and derivatives of a fit.

    Attributes:
        distances_mm: d, (n_distances,).
        normals: of each distance, (n_distances, 3).
        rows: the point of each distance, (n_distances,).
        design: A, (n_distances, n_freedoms).
        by_tip: radii of the ball from its centre to the surface, along each normal,
            (n_distances,): 1, -1, 0 without compensation.
        repeats: samples of a scan that count as one, (n_distances,); 1 of touches.
    """

    distances_mm: Floats
    normals: Floats
    rows: Integers
    design: Floats
    by_tip: Floats
    repeats: Floats

    @property
    def redundancy(self) -> int:
        n_distances, n_freedoms = self.design.shape
        return int(n_distances - n_freedoms)

    @property
    def residual_projector(self) -> Floats:
        """R = 1 - A A^+ of residuals r = R (n . dx), (n_distances, n_distances)."""
        n = len(self.distances_mm)
        projector: Floats = np.eye(n) - self.design @ np.linalg.pinv(self.design)
        return projector

    @property
    def form(self) -> Floats:
        """Weights w of the form deviation w . d, (n_distances,).

        The largest less the smallest distance; of points and of lines in space, with
        several distances a point, the diameter about them that holds all points.
        """
        weights = np.zeros(len(self.distances_mm))
        each = len(self.rows) // len(np.unique(self.rows))
        if each == 1:
            weights[np.argmax(self.distances_mm)] += 1.0
            weights[np.argmin(self.distances_mm)] -= 1.0
            return weights
        vectors_mm = self.distances_mm.reshape(-1, each)
        worst = int(np.argmax(np.linalg.norm(vectors_mm, axis=1)))
        size_mm = float(np.linalg.norm(vectors_mm[worst]))
        if size_mm > 0.0:
            weights[each * worst : each * (worst + 1)] = (
                2.0 * vectors_mm[worst] / size_mm
            )
        return weights


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element of a part.

    Attributes:
        values: q; 0 where the kind has none, (8,).
        by_points: W = dq/dx, (8, n_points, 3).
        fit: None of elements that were made of others.
    """

    kind: Kind
    values: Floats
    by_points: Floats
    fit: Fit | None = None

    @property
    def place_mm(self) -> Floats:
        return self.values[PLACE]

    @property
    def direction(self) -> Floats:
        return self.values[DIRECTION]


def fitted_element(
    kind: Kind,
    values: Floats,
    by_freedoms: Floats,
    points_mm: Floats,
    equations: tuple[Floats, Floats, Floats],
    *,
    rows: Integers | None = None,
) -> Element:
    """Make an element with its derivatives.

    Args:
        kind: of it.
        values: q, (8,).
        by_freedoms: dq/df, (8, n_freedoms).
        points_mm: (n_points, 3).
        equations: distances, their normals, and the design A.
        rows: the point of each distance; None: one distance a point.

    Raises:
        ValueError: the points do not determine it.
    """
    distances_mm, normals, design = equations
    inverse_normal(design / np.linalg.norm(design, axis=0), kind)  # or refuse
    rows = np.arange(len(points_mm)) if rows is None else rows
    by_distances = by_freedoms @ np.linalg.pinv(design)
    by_points = np.zeros((N_VALUES, len(points_mm), 3))
    for row, by_distance, normal in zip(rows, by_distances.T, normals, strict=True):
        by_points[:, row] += by_distance[:, np.newaxis] * normal
    n = len(distances_mm)
    fit = Fit(distances_mm, normals, rows, design, np.zeros(n), np.ones(n))
    return Element(kind, values, by_points, fit)


def point_element(points_mm: Floats) -> Element:
    """Take a point, or the mean of several of one place, (n_points, 3)."""
    points_mm = checked_points(points_mm, LEAST_POINTS["point"])
    n = len(points_mm)
    mean_mm = points_mm.mean(axis=0)
    by_freedoms = np.zeros((N_VALUES, 3))
    by_freedoms[PLACE] = np.eye(3)
    coordinates = np.tile(np.eye(3), (n, 1))
    return fitted_element(
        "point",
        element_values(mean_mm),
        by_freedoms,
        points_mm,
        ((points_mm - mean_mm).ravel(), coordinates, coordinates),
        rows=np.repeat(np.arange(n), 3),
    )


def line_element(points_mm: Floats) -> Element:
    """Fit a line in space, through the balls' centres.

    Raises:
        ValueError: too few points, or they do not determine it; likewise below.
    """
    cloud = cloud_of(points_mm, LEAST_POINTS["line"])
    if not cloud.sizes[1] < 0.9 * cloud.sizes[0]:
        raise ValueError("the points are as wide as they are long, which fits no line")
    direction = turned_positive(cloud.axes[0])
    first, second = across(direction)
    from_mean_mm = np.asarray(points_mm, dtype=np.float64) - cloud.mean_mm
    along_mm, n = from_mean_mm @ direction, len(from_mean_mm)
    distances_mm = (from_mean_mm @ np.stack([first, second], axis=1)).ravel()
    design = np.zeros((2 * n, 4))
    design[0::2, 0], design[0::2, 2] = 1.0, along_mm
    design[1::2, 1], design[1::2, 3] = 1.0, along_mm
    by_freedoms = np.zeros((N_VALUES, 4))
    by_freedoms[PLACE, 0], by_freedoms[PLACE, 1] = first, second
    by_freedoms[DIRECTION, 2], by_freedoms[DIRECTION, 3] = first, second
    equations = distances_mm, np.tile(np.stack([first, second]), (n, 1)), design
    return fitted_element(
        "line",
        element_values(cloud.mean_mm, direction),
        by_freedoms,
        from_mean_mm,
        equations,
        rows=np.repeat(np.arange(n), 2),
    )


def plane_element(
    points_mm: Floats, tip_mm: float = 0.0, outwards: Floats | None = None
) -> Element:
    """Fit a plane.

    Args:
        points_mm: balls' centres, (n_points, 3).
        tip_mm: radius of the ball.
        outwards: about where the normal points, away from the material, (3,).
    """
    plane = fit_plane(points_mm)
    normal = (
        plane.normal if outwards is None else turned_towards(plane.normal, outwards)
    )
    first, second = across(normal)
    from_mean_mm = np.asarray(points_mm, dtype=np.float64) - plane.point_mm
    design = np.column_stack(
        [np.ones(len(from_mean_mm)), -from_mean_mm @ first, -from_mean_mm @ second]
    )
    by_freedoms = np.zeros((N_VALUES, 3))
    by_freedoms[PLACE] = np.stack([normal, -tip_mm * first, -tip_mm * second], axis=1)
    by_freedoms[DIRECTION, 1], by_freedoms[DIRECTION, 2] = first, second
    normals = np.broadcast_to(normal, from_mean_mm.shape)
    return fitted_element(
        "plane",
        element_values(plane.point_mm - tip_mm * normal, normal),
        by_freedoms,
        from_mean_mm,
        (from_mean_mm @ normal, normals, design),
    )


def sphere_element(points_mm: Floats, offset_mm: float = 0.0) -> Element:
    """Fit a sphere to balls' centres; the surface is `offset_mm` further out."""
    sphere = fit_sphere(points_mm)
    from_centre_mm = np.asarray(points_mm, dtype=np.float64) - sphere.centre_mm
    lengths_mm = np.linalg.norm(from_centre_mm, axis=1)
    normals = from_centre_mm / lengths_mm[:, np.newaxis]
    by_freedoms = np.zeros((N_VALUES, 4))
    by_freedoms[PLACE, :3], by_freedoms[RADIUS, 3] = np.eye(3), 1.0
    design = np.column_stack([normals, np.ones(len(normals))])
    values = element_values(
        sphere.centre_mm, radius_mm=positive_radius(sphere.radius_mm + offset_mm)
    )
    equations = lengths_mm - sphere.radius_mm, normals, design
    return fitted_element("sphere", values, by_freedoms, from_centre_mm, equations)


def element_values(
    place_mm: Floats,
    direction: Floats | None = None,
    radius_mm: float = 0.0,
    angle_rad: float = 0.0,
) -> Floats:
    directed = np.zeros(3) if direction is None else direction
    values: Floats = np.concatenate([place_mm, directed, [radius_mm, angle_rad]])
    return values


def positive_radius(radius_mm: float) -> float:
    """Return a radius of a surface.

    Raises:
        ValueError: it is not positive, as of a shaft smaller than the ball.
    """
    if not radius_mm > 0.0:
        raise ValueError(
            "the ball is larger than what it touched; was it touched from inside?"
        )
    return radius_mm


def turned_towards(direction: Floats, towards: Floats) -> Floats:
    """Reverse a direction that points away from another.

    Raises:
        ValueError: they are nearly square to each other, so that nobody knows.
    """
    along = float(direction @ towards) / float(np.linalg.norm(towards))
    if abs(along) < 0.1:
        raise ValueError(
            "the side of the material is not known: the probe stood along the surface; "
            "touch with tip compensation (pretouch or pulled)"
        )
    turned: Floats = direction * np.sign(along)
    return turned

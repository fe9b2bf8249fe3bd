"""A plane and a line through the mean m of points, exactly by singular values.

The distance is (p - m) . n for a plane, the part of p - m across u for a line.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import (
    FLAT,
    Precision,
    cloud_of,
    turned_positive,
)
from traverse.kinematics.model.geometry import across


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A fitted plane.

    Attributes:
        point_mm: The mean of the points, (3,).
        normal: Unit vector, its largest component positive, (3,).
        rms_mm: Root mean square of the distances.
        precision: Of the point (mm), which moves along the normal only, and of the
            normal: (6, 6).
    """

    point_mm: Floats
    normal: Floats
    rms_mm: float
    precision: Precision


def fit_plane(points_mm: Floats) -> Plane:
    """Fit a plane to at least three points, (n_points, 3).

    Raises:
        ValueError: Too few points, on one line, or spread alike in all directions.
    """
    cloud = cloud_of(points_mm, at_least=3)
    cloud.refuse_degenerate("plane", flat=False)
    if not cloud.sizes[2] < (1.0 - FLAT) * cloud.sizes[1]:
        raise ValueError(
            f"the {len(cloud.points)} points are as thick as they are wide, which fits "
            "no single plane; leave out those that are not on it"
        )
    normal = turned_positive(cloud.axes[2])
    first, second = across(normal)
    points = cloud.points
    design = np.column_stack([-np.ones(len(points)), points @ first, points @ second])
    known = np.zeros((6, 3))
    known[:3, 0] = normal
    known[3:, 1], known[3:, 2] = first / cloud.extent_mm, second / cloud.extent_mm
    quality = cloud.quality("plane", points @ normal, design, known)
    return Plane(cloud.mean_mm, normal, *quality)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A fitted line.

    Attributes:
        point_mm: The mean of the points, (3,).
        direction: Unit vector, its largest component positive, (3,).
        rms_mm: Root mean square of the distances.
        precision: Of the point (mm), which moves across the line only, and of the
            direction: (6, 6). Every distance has two components.
    """

    point_mm: Floats
    direction: Floats
    rms_mm: float
    precision: Precision


def fit_line(points_mm: Floats) -> Line:
    """Fit a line to at least two points, (n_points, 3).

    Raises:
        ValueError: Too few points, in one place, or spread alike in two directions.
    """
    cloud = cloud_of(points_mm, at_least=2)
    if not cloud.sizes[1] < (1.0 - FLAT) * cloud.sizes[0]:
        raise ValueError(
            f"the {len(cloud.points)} points are as wide as they are long, which fits "
            "no single line; leave out those that are not on it"
        )
    direction = turned_positive(cloud.axes[0])
    first, second = across(direction)
    points = cloud.points
    along, none, one = points @ direction, np.zeros(len(points)), np.ones(len(points))
    design = np.block(
        [
            [np.column_stack([-one, none, -along, none])],
            [np.column_stack([none, -one, none, -along])],
        ]
    )
    known = np.zeros((6, 4))
    known[:3, 0], known[:3, 1] = first, second
    known[3:, 2], known[3:, 3] = first / cloud.extent_mm, second / cloud.extent_mm
    away = np.concatenate([points @ first, points @ second])
    quality = cloud.quality("line", away, design, known)
    return Line(cloud.mean_mm, direction, *quality)

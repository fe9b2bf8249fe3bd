"""A plane through the mean m of points, exactly by singular values.

The distance is (p - m) . n.
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

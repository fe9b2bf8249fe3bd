"""A plane: (p - m) . n, exactly by singular values; m is the mean of the points."""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.fits.adjustment import (
    FLAT,
    Precision,
    cloud_of,
    inverse_normal,
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
    normal = cloud.axes[2] * np.sign(cloud.axes[2][np.argmax(np.abs(cloud.axes[2]))])
    first, second = across(normal)
    points = cloud.points
    design = np.column_stack([-np.ones(len(points)), points @ first, points @ second])
    known = np.zeros((6, 3))
    known[:3, 0] = normal
    known[3:, 1], known[3:, 2] = first / cloud.extent_mm, second / cloud.extent_mm
    distances_mm = cloud.extent_mm * (points @ normal)
    squares_mm2 = float(distances_mm @ distances_mm)
    return Plane(
        point_mm=cloud.mean_mm,
        normal=normal,
        rms_mm=float(np.sqrt(squares_mm2 / len(points))),
        precision=Precision(
            known @ inverse_normal(design, "plane") @ known.T,
            len(points) - 3,
            squares_mm2,
        ),
    )

"""A line: the part of p - m across u, exactly by singular values; m is the mean."""

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
    longest = cloud.axes[0]
    direction = longest * np.sign(longest[np.argmax(np.abs(longest))])
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
    away_mm = cloud.extent_mm * np.concatenate([points @ first, points @ second])
    squares_mm2 = float(away_mm @ away_mm)
    return Line(
        point_mm=cloud.mean_mm,
        direction=direction,
        rms_mm=float(np.sqrt(squares_mm2 / len(points))),
        precision=Precision(
            known @ inverse_normal(design, "line") @ known.T,
            2 * len(points) - 4,
            squares_mm2,
        ),
    )

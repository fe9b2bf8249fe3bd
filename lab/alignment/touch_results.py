"""What is told of the touches and features of a 3-2-1 alignment."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.helmert.shape import direction_text, shape_of
from traverse.kinematics.helmert.volume import VolumeError
from traverse.lab.alignment.flags import POOR_INDEX, STRAIGHT
from traverse.lab.alignment.nominal import Nominal
from traverse.lab.alignment.plane_line_point_frames import PlaneLinePointTouches
from traverse.lab.alignment.result import AlignmentWarning, PointResult
from traverse.lab.alignment.statistics import FOUND, point_p_value
from traverse.lab.alignment.touches import Touch

_AXES = ("along the line", "across the line", "off the plane")


def touch_results(
    *,
    names: Sequence[str],
    touched: PlaneLinePointTouches,
    axes: Floats,
    axis: Integers,
    residuals_mm: Floats,
    shares: Floats,
    stds_mm: Floats,
    in_volume: Floats,
    is_stated: bool,
) -> Iterator[PointResult]:
    """Say of every touch what its error could have done, and whether it was seen.

    Args:
        names: Of the features, (n,).
        touched: The touches, n in all.
        axes: Of the nominal frame, as columns.
        axis: Which of these counts, (n,).
        residuals_mm: Along it, (n,).
        shares: Redundancy numbers, (n,).
        stds_mm: Of the touches along it, (n,).
        in_volume: What an error of 1 mm does to the volume, (n,).
        is_stated: Whether errors are stated.
    """
    for row, name in enumerate(names):
        way, share = axes[:, axis[row]], float(shares[row])
        least_mm = FOUND * float(stds_mm[row]) / np.sqrt(share) if share else None
        hidden_mm = None if least_mm is None else least_mm * float(in_volume[row])
        statistic = (residuals_mm[row] / stds_mm[row]) ** 2 / share if share else 0.0
        yield PointResult(
            name=name,
            measured_mm=touched.all_mm[row],
            nominal_mm=None,
            residual_mm=residuals_mm[row] * way,
            touches=1,
            spread_mm=None,
            redundancy=share * way**2,
            detectable_mm=(least_mm, least_mm),
            worst_direction=way,
            hidden_mm=hidden_mm,
            hidden_ratio=float(in_volume[row]),
            p_value=point_p_value(float(statistic), int(share > 0.0))
            if is_stated
            else None,
        )


def plane_flags(index: VolumeError, on_plane_mm: Floats) -> Iterator[AlignmentWarning]:
    """Flag what the disposition of the touches leaves weak.

    Args:
        index: Of their disposition.
        on_plane_mm: Touches of the plane in the part's system, (n, 3).
    """
    shape = shape_of(on_plane_mm)
    if shape.straightness < STRAIGHT:
        yield AlignmentWarning(
            "nearly_collinear",
            f"the touches of the plane are nearly collinear (within "
            f"{shape.straightness:.1%} of their length): the rotation about the "
            f"direction {direction_text(shape.axes[0])} is hardly determined; touch "
            "the plane far beside that line",
            shape.axes[0],
        )
    if index.rms_mm > POOR_INDEX:
        yield AlignmentWarning(
            "small_for_the_volume",
            f"places in the volume are {index.rms_mm:.1f} times as uncertain as a "
            f"touch, {index.max_mm:.1f} times at its worst place: plane and line are "
            "touched too close together for it",
        )


def centre_flags(touches: Sequence[Touch]) -> Iterator[AlignmentWarning]:
    """Flag places that are not on the surfaces that the nominal file tells of."""
    off_mm = max((touch.off_mm or 0.0 for touch in touches), default=0.0)
    if off_mm > 0.0:
        yield AlignmentWarning(
            "ball_centres",
            f"touches are centres of a ball of {off_mm:g} mm radius: nominal plane, "
            "line and point have to lie so far off the surfaces; else take points with "
            "compensation, and use --coordinates surface",
        )


def feature_values(
    nominal: Nominal, axis: Integers, heights_mm: Floats
) -> Iterator[dict[str, Any]]:
    """Say how the features fit."""
    for what, which, freedoms in (("plane", 2, 3), ("line", 1, 2), ("point", 0, 1)):
        rows = heights_mm[axis == which]
        feature = getattr(nominal, what)
        yield {
            "kind": what,
            "feature": feature.feature,
            "touches": len(rows),
            "counts": _AXES[which],
            "redundancy": len(rows) - freedoms,
            "rms_mm": float(np.sqrt(np.mean(rows**2))),
        }

"""A leapfrog joined to the alignment of the first station: both errors add up."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import N_RIGID, moved_centre
from traverse.kinematics.helmert.volume import Ball
from traverse.lab.alignment.files import transformation_of
from traverse.lab.alignment.result import (
    covariance_values,
    predicted_values,
    volume_values,
)


def chained_values(
    values: Mapping[str, Any], first: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """Put an alignment before another one: arm to station 1, station 1 to the part.

    Returns:
        The values with the joined alignment, its covariance, and the volume, turned
        into the part's system; residuals and points stay those of the leapfrog.
    """
    outer, inner = transformation_of(first), transformation_of(values)
    joined = outer.after(inner)
    covariance, centre_mm = _joined_covariance(values, first)
    quality = dict(values["quality"])
    volume = quality["volume"]
    ball = _around(volume)
    middle_mm = outer.places_mm(ball.mean_mm[np.newaxis])[0]
    there = Ball(middle_mm, outer.scale * ball.radius_mm)
    where = f"{volume['source']}, in the system of {source}"
    quality |= {
        "volume": volume_values(there, where),
        **predicted_values(there, centre_mm, covariance),
    }
    remarks = [
        *values["remarks"],
        f"joined with {source}, which was computed {first['date_utc']}; residuals, "
        "points and index are the leapfrog's, in the system of the first station",
    ]
    if covariance is None:
        remarks.append(f"{source} tells no errors, so none are told of both")
    return {
        **values,
        "alignment": {
            **values["alignment"],
            "name": first["alignment"]["name"],
            "rotation": joined.rotation.tolist(),
            "translation_mm": joined.translation_mm.tolist(),
            "scale": joined.scale,
        },
        "covariance": None
        if covariance is None
        else covariance_values(covariance, centre_mm),
        "quality": quality,
        "joined_with": {"file": source, "alignment": first["alignment"]},
        "passed": bool(values["passed"] and first["passed"]),
        "flags": [
            *values["flags"],
            *({**flag, "text": f"{source}: {flag['text']}"} for flag in first["flags"]),
        ],
        "remarks": remarks,
    }


def _joined_covariance(
    values: Mapping[str, Any], first: Mapping[str, Any]
) -> tuple[Floats | None, Floats]:
    """Add the covariance of the leapfrog, turned, to that of the first station."""
    if first["covariance"] is None or values["covariance"] is None:
        return None, np.zeros(3)
    outer = transformation_of(first)
    told = [one["covariance"] for one in (values, first)]
    matrices = [np.array(one["matrix"]) for one in told]
    n_parameters = max(map(len, matrices))
    # A scale that is not adjusted is exact.
    padded = [np.pad(one, (0, n_parameters - len(one))) for one in matrices]
    turned = np.eye(n_parameters)
    turned[:3, :3] = outer.scale * outer.rotation
    turned[3:N_RIGID, 3:N_RIGID] = outer.rotation
    inner_centre_mm = outer.places_mm(np.array([told[0]["centre_mm"]]))[0]
    centre_mm = np.array(told[1]["centre_mm"])
    inner = moved_centre(turned @ padded[0] @ turned.T, inner_centre_mm, centre_mm)
    return inner + padded[1], centre_mm


def _around(volume: Mapping[str, Any]) -> Ball:
    """Take the ball of a volume, or that around its box."""
    if volume["kind"] == "ball":
        return Ball(np.array(volume["centre_mm"]), float(volume["radius_mm"]))
    low_mm, high_mm = np.array(volume["min_mm"]), np.array(volume["max_mm"])
    return Ball(0.5 * (low_mm + high_mm), 0.5 * float(np.linalg.norm(high_mm - low_mm)))

"""An alignment as plain values: alignment.json, schema traverse/alignment/1."""

from datetime import UTC, datetime
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import PARAMETERS
from traverse.kinematics.helmert.volume import (
    Volume,
    VolumeError,
    place_covariances,
    volume_error,
)
from traverse.lab.alignment.result import (
    AlignmentResult,
    PointResult,
    volume_values,
)
from traverse.lab.alignment.statistics import POINT_LEVEL, POWER

SCHEMA = "traverse/alignment/1"


def alignment_values(
    found: AlignmentResult,
    *,
    name: str,
    arm: str | None,
    measured: str,
    nominal: str,
    when: datetime | None = None,
) -> dict[str, Any]:
    """Put everything into plain values.

    Args:
        found: The alignment.
        name: What it is called.
        arm: Name of the arm; None where it is not known.
        measured: Where the touches come from.
        nominal: Where the nominal places come from.
        when: Of the computation; default now.
    """
    moment = (when or datetime.now(UTC)).replace(microsecond=0)
    transformation, test = found.transformation, found.test
    return {
        "schema": SCHEMA,
        "method": found.method,
        "date_utc": moment.isoformat().replace("+00:00", "Z"),
        "arm": arm,
        "measured": measured,
        "nominal": nominal,
        # As the command `align` takes it.
        "alignment": {
            "action": "set",
            "name": name,
            "rotation": transformation.rotation.tolist(),
            "translation_mm": transformation.translation_mm.tolist(),
            "scale": transformation.scale,
        },
        "passed": found.is_good,
        "covariance": None
        if found.covariance is None
        else covariance_values(found.covariance, found.centre_mm),
        "errors_stated": found.is_stated,
        "sigma0": None if test is None else test.sigma0,
        "sigma0_unit": "1" if found.is_stated else "mm",
        "sigma0_interval": None if test is None else list(test.interval),
        "redundancy": 0 if test is None else test.redundancy,
        "global_test": None if test is None else test.values(),
        "point_test": {"level": POINT_LEVEL, "power": POWER},
        "quality": _quality(found),
        "points": [_point(point) for point in found.points],
        "features": list(found.features),
        "flags": [
            {
                "code": flag.code,
                "text": flag.text,
                "direction": _listed(flag.direction),
            }
            for flag in found.flags
        ],
        "remarks": list(found.remarks),
    }


def covariance_values(covariance: Floats, centre_mm: Floats) -> dict[str, Any]:
    """Write the covariance of xi about a centre."""
    variances = np.maximum(np.diag(covariance), 0.0)
    return {
        "parameters": list(PARAMETERS[: len(covariance)]),
        "centre_mm": centre_mm.tolist(),
        "matrix": covariance.tolist(),
        "std": np.sqrt(variances).tolist(),
    }


def _quality(found: AlignmentResult) -> dict[str, Any]:
    return {
        "volume": volume_values(found.volume, found.volume_source),
        "index": error_values(found.index),
        **predicted_values(found.volume, found.centre_mm, found.covariance),
    }


def predicted_values(
    volume: Volume, centre_mm: Floats, covariance: Floats | None
) -> dict[str, Any]:
    """Say the errors in a volume, and at its middle and its corners."""
    if covariance is None:
        return {"predicted_error_mm": None, "places": []}
    places_mm = np.vstack([volume.mean_mm, volume.corners_mm])
    errors = place_covariances(places_mm, centre_mm, covariance)
    return {
        "predicted_error_mm": error_values(volume_error(volume, centre_mm, covariance)),
        "places": [
            {
                "place_mm": place.tolist(),
                "rms_mm": float(np.sqrt(np.trace(error))),
                "covariance_mm2": error.tolist(),
            }
            for place, error in zip(places_mm, errors, strict=True)
        ],
    }


def error_values(error: VolumeError) -> dict[str, Any]:
    """Write errors of position in a volume."""
    at_mm = error.max_at_mm.tolist()
    return {"rms": error.rms_mm, "max": error.max_mm, "max_at_mm": at_mm}


def _point(point: PointResult) -> dict[str, Any]:
    best, worst = point.detectable_mm
    return {
        "name": point.name,
        "measured_mm": point.measured_mm.tolist(),
        "nominal_mm": _listed(point.nominal_mm),
        "residual_mm": point.residual_mm.tolist(),
        "residual_length_mm": float(np.linalg.norm(point.residual_mm)),
        "touches": point.touches,
        "spread_mm": point.spread_mm,
        "redundancy": point.redundancy.tolist(),
        "p_value": point.p_value,
        "detectable_mm": {"best": best, "worst": worst},
        "worst_direction": point.worst_direction.tolist(),
        "hidden_in_volume_mm": point.hidden_mm,
        "hidden_in_volume_per_mm": point.hidden_ratio,
    }


def _listed(vector: Floats | None) -> list[float] | None:
    return None if vector is None else vector.tolist()

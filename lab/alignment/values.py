"""An alignment as plain values: alignment.json, schema traverse/alignment/1."""

from datetime import UTC, datetime
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import PARAMETERS
from traverse.kinematics.helmert.volume import Volume, place_covariances
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
        "covariance": _covariance(found),
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


def _covariance(found: AlignmentResult) -> dict[str, Any] | None:
    if found.covariance is None:
        return None
    variances = np.maximum(np.diag(found.covariance), 0.0)
    return {
        "parameters": list(PARAMETERS[: len(found.covariance)]),
        "centre_mm": found.centre_mm.tolist(),
        "matrix": found.covariance.tolist(),
        "std": np.sqrt(variances).tolist(),
    }


def _quality(found: AlignmentResult) -> dict[str, Any]:
    index, predicted = found.index, found.predicted
    return {
        "volume": volume_values(found.volume, found.volume_source),
        "index": {
            "rms": index.rms_mm,
            "max": index.max_mm,
            "max_at_mm": index.max_at_mm.tolist(),
        },
        "predicted_error_mm": None
        if predicted is None
        else {
            "rms": predicted.rms_mm,
            "max": predicted.max_mm,
            "max_at_mm": predicted.max_at_mm.tolist(),
        },
        "places": [] if found.covariance is None else _places(found, found.covariance),
    }


def _places(found: AlignmentResult, covariance: Floats) -> list[dict[str, Any]]:
    """Say the errors at the middle and the corners of the volume."""
    volume: Volume = found.volume
    places_mm = np.vstack([volume.mean_mm, volume.corners_mm])
    errors = place_covariances(places_mm, found.centre_mm, covariance)
    return [
        {
            "place_mm": place.tolist(),
            "rms_mm": float(np.sqrt(np.trace(error))),
            "covariance_mm2": error.tolist(),
        }
        for place, error in zip(places_mm, errors, strict=True)
    ]


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

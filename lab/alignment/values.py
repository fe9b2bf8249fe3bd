"""alignment.json as plain values (traverse/alignment/1): words and page print these."""

from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import PARAMETERS
from traverse.kinematics.helmert.volume import (
    Ball,
    Volume,
    VolumeError,
    place_covariances,
    volume_error,
)
from traverse.lab.alignment.result import POINT_LEVEL, POWER, AlignmentResult
from traverse.lab.outcomes.base import State
from traverse.lab.report.provenance import (
    ReportProvenance,
    ReportSource,
    report_provenance,
)
from traverse.lab.report.quantities import picked, plain_values

TITLES = {
    State.GOOD: "Usable",
    State.DOUBT: "Usable with reservations",
    State.BAD: "Not usable",
}


def volume_values(volume: Volume, source: str) -> dict[str, Any]:
    """Write a volume as in alignment.json."""
    if isinstance(volume, Ball):
        shape = {"centre_mm": volume.mean_mm.tolist(), "radius_mm": volume.radius_mm}
        return {"kind": "ball", **shape, "source": source}
    corners = {"min_mm": volume.low_mm.tolist(), "max_mm": volume.high_mm.tolist()}
    return {"kind": "box", **corners, "source": source}


SCHEMA = "traverse/alignment/1"


def alignment_values(
    result: AlignmentResult,
    *,
    name: str,
    arm: str | None,
    measured: str,
    nominal: str,
    provenance: ReportProvenance | None = None,
) -> dict[str, Any]:
    """Put everything into plain values; computed by this user now if not said."""
    origin = provenance or report_provenance(ReportSource(measured, ""))
    transformation, test, outcome = result.transformation, result.test, result.outcome
    return {
        "schema": SCHEMA,
        "method": result.method,
        "date_utc": origin.date_utc,
        "provenance": origin.values,
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
        **plain_values(outcome),
        "verdict": TITLES[outcome.state],
        "passed": result.is_good,
        "covariance": None
        if result.covariance is None
        else covariance_values(result.covariance, result.centre_mm),
        "errors_stated": result.is_stated,
        "sigma0": None if test is None else test.sigma0,
        "sigma0_unit": "1" if result.is_stated else "mm",
        "sigma0_interval": None if test is None else list(test.interval),
        "redundancy": 0 if test is None else test.redundancy,
        "global_test": None if test is None else test.values(),
        "point_test": {"level": POINT_LEVEL, "power": POWER},
        "quality": {
            "volume": volume_values(result.volume, result.volume_source),
            "index": error_values(result.index),
            **predicted_values(result.volume, result.centre_mm, result.covariance),
        },
        **picked(result, "points", "features", "flags", "remarks"),
    }


def covariance_values(covariance: Floats, centre_mm: Floats) -> dict[str, Any]:
    variances = np.maximum(np.diag(covariance), 0.0)
    return {
        "parameters": list(PARAMETERS[: len(covariance)]),
        "centre_mm": centre_mm.tolist(),
        "matrix": covariance.tolist(),
        "std": np.sqrt(variances).tolist(),
    }


def predicted_values(
    volume: Volume, centre_mm: Floats, covariance: Floats | None
) -> dict[str, Any]:
    """Return the errors in a volume, and at its middle and its corners."""
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
    at_mm = error.max_at_mm.tolist()
    return {"rms": error.rms_mm, "max": error.max_mm, "max_at_mm": at_mm}

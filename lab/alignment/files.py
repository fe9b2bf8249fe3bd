"""Files of an alignment: its plain values, its page, and lines for a terminal."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import (
    N_RIGID,
    PARAMETERS,
    Helmert,
    moved_centre,
)
from traverse.kinematics.helmert.volume import (
    Ball,
    Volume,
    VolumeError,
    place_covariances,
    volume_error,
)
from traverse.lab.alignment.pictures import alignment_paintings
from traverse.lab.alignment.result import POINT_LEVEL, POWER, AlignmentResult
from traverse.lab.outcomes.base import State, worst
from traverse.lab.report.figures import painted
from traverse.lab.report.provenance import (
    ReportProvenance,
    ReportSource,
    report_provenance,
)
from traverse.lab.report.quantities import picked, plain_values
from traverse.lab.report.templates import Filters, Words, page
from traverse.protocol.messages import AlignArgs
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import write_atomically

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


FILE = "alignment.json"
_WIDTH_MM = 175.0


def _turn_degrees(rotation: list[list[float]]) -> float:
    cosine = np.clip(0.5 * (np.trace(np.array(rotation)) - 1.0), -1.0, 1.0)
    return float(np.degrees(np.arccos(cosine)))


_FILTERS: Filters = {
    "turn_degrees": _turn_degrees,
    # Adding zero takes the sign from what is rounded to nothing.
    "unsigned_zero": lambda value, digits: round(value, digits) + 0.0,
}
WORDS = Words("alignment/words.jinja", **_FILTERS)


def alignment_page(values: Mapping[str, Any]) -> str:
    """Make the page; the text is complete in itself."""
    return page(
        "alignment/page.jinja",
        _FILTERS,
        values=values,
        alignment=values["alignment"],
        words=WORDS,
        pictures=painted(alignment_paintings(values), _WIDTH_MM),
    )


def write_alignment(values: Mapping[str, Any], folder: Path) -> None:
    """Write alignment.html and alignment.json into a folder, made if need be.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / "alignment.html", alignment_page(values))
    text = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
    write_atomically(folder / FILE, f"{text}\n")


def read_alignment(path: Path) -> dict[str, Any]:
    """Read an alignment.json, or the folder that it is in.

    Raises:
        FileError: It is none.
        OSError: It cannot be read.
    """
    file = path / FILE if path.is_dir() else path
    try:
        values = json_of(file)
        if not isinstance(values, dict) or values.get("schema") != SCHEMA:
            raise ValueError(f"its schema is not {SCHEMA}")
        if values.get("state") not in list(State) or "reasons" not in values:
            raise ValueError("it has no state; align the points again")
        align_args(values)
    except ValueError as error:
        message = f"is no alignment: {str(error).splitlines()[0]}"
        raise FileError(file, message) from error
    return values


def transformation_of(values: Mapping[str, Any]) -> Helmert:
    """Take the transformation out of an alignment's values."""
    alignment = values["alignment"]
    return Helmert(
        np.array(alignment["rotation"]),
        np.array(alignment["translation_mm"]),
        float(alignment["scale"]),
    )


def align_args(values: Mapping[str, Any]) -> AlignArgs:
    """Make the arguments of the command `align` of an alignment's values.

    Raises:
        ValueError: It is no alignment.
    """
    return AlignArgs.model_validate_json(json.dumps(values.get("alignment")))


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
    chained = Ball(middle_mm, outer.scale * ball.radius_mm)
    where = f"{volume['source']}, in the system of {source}"
    quality |= {
        "volume": volume_values(chained, where),
        **predicted_values(chained, centre_mm, covariance),
    }
    state = worst([State(values["state"]), State(first["state"])])
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
        "state": state.value,
        "verdict": TITLES[state],
        "reasons": [
            *values["reasons"],
            *(
                {**reason, "text": f"{source}: {reason['text']}"}
                for reason in first["reasons"]
            ),
        ],
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
    stated = [entry["covariance"] for entry in (values, first)]
    matrices = [np.array(entry["matrix"]) for entry in stated]
    n_parameters = max(map(len, matrices))
    # A scale that is not adjusted is exact.
    padded = [np.pad(entry, (0, n_parameters - len(entry))) for entry in matrices]
    turned = np.eye(n_parameters)
    turned[:3, :3] = outer.scale * outer.rotation
    turned[3:N_RIGID, 3:N_RIGID] = outer.rotation
    inner_centre_mm = outer.places_mm(np.array([stated[0]["centre_mm"]]))[0]
    centre_mm = np.array(stated[1]["centre_mm"])
    inner = moved_centre(turned @ padded[0] @ turned.T, inner_centre_mm, centre_mm)
    return inner + padded[1], centre_mm


def _around(volume: Mapping[str, Any]) -> Ball:
    """Take the ball of a volume, or that around its box."""
    if volume["kind"] == "ball":
        return Ball(np.array(volume["centre_mm"]), float(volume["radius_mm"]))
    low_mm, high_mm = np.array(volume["min_mm"]), np.array(volume["max_mm"])
    return Ball(0.5 * (low_mm + high_mm), 0.5 * float(np.linalg.norm(high_mm - low_mm)))

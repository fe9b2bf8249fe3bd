"""Files of an alignment, and its text: its page, and lines for a terminal."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import N_RIGID, Helmert, moved_centre
from traverse.kinematics.helmert.volume import Ball
from traverse.lab.alignment.pictures import alignment_paintings
from traverse.lab.alignment.values import (
    SCHEMA,
    TITLES,
    covariance_values,
    predicted_values,
    volume_values,
)
from traverse.lab.outcomes.base import State, worst
from traverse.lab.report.figures import painted
from traverse.lab.report.templates import Filters, Words, page
from traverse.protocol.messages import AlignArgs
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import write_atomically

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

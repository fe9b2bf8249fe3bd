"""Files of an alignment, and its text: its page, and lines for a terminal."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from traverse.kinematics.helmert.transformation import Helmert
from traverse.lab.alignment.pictures import alignment_paintings
from traverse.lab.alignment.result import SCHEMA
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
    "sentence": lambda text: f"{text[0].upper()}{text[1:]}.",
    # Adding zero takes the sign from what is rounded to nothing.
    "unsigned_zero": lambda value, digits: round(value, digits) + 0.0,
}
WORDS = Words("alignment/words.jinja", **_FILTERS)


def alignment_lines(values: Mapping[str, Any]) -> list[str]:
    """Describe an alignment in lines."""
    return WORDS.lines("summary", values)


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
        align_args(values)
    except ValueError as error:
        message = f"is no alignment: {str(error).splitlines()[0]}"
        raise FileError(file, message) from error
    return values


def transformation_of(values: Mapping[str, Any]) -> Helmert:
    """Take the transformation out of an alignment's values."""
    given = values["alignment"]
    return Helmert(
        np.array(given["rotation"]),
        np.array(given["translation_mm"]),
        float(given["scale"]),
    )


def align_args(values: Mapping[str, Any]) -> AlignArgs:
    """Make the arguments of the command `align` of an alignment's values.

    Raises:
        ValueError: It is no alignment.
    """
    return AlignArgs.model_validate_json(json.dumps(values.get("alignment")))

"""The alignment as a page, everything in one file; and as lines for a terminal."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from traverse.lab.alignment.pictures import alignment_paintings
from traverse.lab.report.figures import painted
from traverse.lab.report.templates import Filters, Words, page

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

"""What a digital calibration certificate states, and its text by a template.

Uncertainties are rounded to two digits and their values to the same place (GUM 7.2.6).
"""

from collections.abc import Mapping
from math import erf, floor, log10, sqrt
from typing import Any, Literal

from traverse.lab.report.templates import Filters, page

COVERAGE_FACTOR = 2.0

# Units of D-SI (BIPM SI brochure) by those of reports.
UNITS = {
    "": r"\one",
    "mm": r"\milli\metre",
    "rad": r"\radian",
    "s": r"\second",
    "C": r"\degreecelsius",
    "ppm": r"\ppm",
    "rad/C": r"\radian\degreecelsius\tothe{-1}",
    "rad/s": r"\radian\second\tothe{-1}",
    "rad/(N m)": r"\radian\newton\tothe{-1}\metre\tothe{-1}",
    "1/C": r"\degreecelsius\tothe{-1}",
    "mm/N": r"\milli\metre\newton\tothe{-1}",
    "mm/s": r"\milli\metre\second\tothe{-1}",
}

_MOST_DECIMALS = 15


def quantity(
    value: float,
    unit: str,
    expanded: float | None = None,
    coverage_factor: float = COVERAGE_FACTOR,
) -> dict[str, str]:
    """Describe a number, with its expanded uncertainty where that is stated.

    Raises:
        KeyError: D-SI has no such unit.
    """
    found = {"unit": UNITS[unit], "expanded": ""}
    if not expanded:
        # Four decimals of a millimetre, as on paper; six digits of anything else.
        decimals = 4 if unit in ("mm", "C") else _decimals(value, 6)
        text = str(value) if isinstance(value, int) else f"{value:.{decimals}f}"
        return found | {"value": text}
    decimals = _decimals(expanded, 2)
    return found | {
        "value": f"{value:.{decimals}f}",
        "expanded": f"{expanded:.{decimals}f}",
        "coverage_factor": f"{coverage_factor:g}",
        "probability": f"{erf(coverage_factor / sqrt(2.0)):.4f}",
    }


def _decimals(number: float, digits: int) -> int:
    if number == 0.0:
        return digits
    return min(max(digits - 1 - floor(log10(abs(number))), 0), _MOST_DECIMALS)


def _line(text: str) -> str:
    """Put a text into one line without spaces around it; escaped stays escaped."""
    return type(text)(" ".join(text.split()))


def _conformity(values: Mapping[str, Any]) -> str | None:
    """Conformity of all figures of a verification; None where it is not decided."""
    verdicts = {figure["verdict"] for figure in values["figures"]}
    if "reject" in verdicts:
        return "fail"
    return "pass" if verdicts == {"accept"} and not values["missing"] else None


_FILTERS: Filters = {"quantity": quantity, "line": _line, "conformity": _conformity}


def certificate_text(
    kind: Literal["verification", "identification"],
    values: Mapping[str, Any],
    administration: Mapping[str, Any],
    digest: str,
    **stated: object,
) -> str:
    """Write the certificate of the values of a `certificate.json` or identification.

    Args:
        kind: Whose values these are.
        values: As in the file.
        administration: Who measured what, where and when.
        digest: Of the values of the arm file.
        stated: What the laboratory states: `laboratory`, `issued` and `files`.

    Raises:
        ValueError: Something is missing without which nothing is certified.
    """
    if None in (administration[f"measured_{end}_utc"] for end in ("from", "to")):
        raise ValueError(
            "the date of the measurement is not stated, without which nothing is "
            "certified; give start_utc in campaign.toml, or time_ns with points"
        )
    if kind == "verification" and not values["figures"]:
        raise ValueError("no figure of the standard was computed; complete the touches")
    return page(
        f"certificates/{kind}.jinja",
        _FILTERS,
        values=values,
        administration=administration,
        digest=digest,
        **stated,
    )

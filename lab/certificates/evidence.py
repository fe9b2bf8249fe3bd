"""Evidence that is certified: a folder of a verification or of an identification.

Its figures are computed again from the raw data in it before anything is signed, and
whenever a certificate is checked. Its certificate is text by a template; uncertainties
are rounded to two digits and their values to the same place (GUM 7.2.6).
"""

import json
import shutil
from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime
from math import erf, floor, log10, sqrt
from pathlib import Path
from typing import Any, Literal

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, arm_digest, read_arm
from traverse.kinematics.uncertainty.arm_covariance import read_arm_covariance
from traverse.lab.acceptance.administration import administration_of
from traverse.lab.acceptance.certificate.check import (
    CERTIFICATE,
    DATA,
    PAGES,
    certificate_problems,
)
from traverse.lab.acceptance.laboratory import Laboratory, refuse_early_issue
from traverse.lab.acceptance.limits import NO_LIMITS
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.files import (
    IDENTIFICATION,
    IDENTIFICATION_FILES,
    SCHEMA,
    identification_json,
    identified_arm,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.measured_points.reading import files_read, measured_campaign
from traverse.lab.outcomes.adjustment import COVARIANCE_FILE
from traverse.lab.report.provenance import digest_of_files, sums_of
from traverse.lab.report.quantities import differences, plain_values
from traverse.lab.report.templates import Filters, MissingValueError, page
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError

_DESIGN = "design.toml"
_ARM = "arm.toml"
# Neither figures nor data: when, by whom and how it was computed, and advice.
_NOT_ALONE = {
    "holdout": "a part of the poses was kept aside; identify with all of them",
    "family": "what its family says took part; identify from its own poses alone",
}
_NOT_COMPARED = ("provenance", "iterations", "suggestions", "holdout")


COVERAGE_FACTOR = 2.0

# Units of D-SI (BIPM SI brochure) by those of reports.
UNITS = {
    "": r"\one",
    "mm": r"\milli\metre",
    "rad": r"\radian",
    "s": r"\second",
    "C": r"\degreecelsius",
    "ppm": r"\ppm",
    "percent": r"\percent",
    "hPa": r"\hecto\pascal",
    "min": r"\minute",
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
    probability: float | None = None,
) -> dict[str, str]:
    """Describe a number, with its expanded uncertainty where that is stated.

    Without a probability the coverage factor is that of a normal distribution.

    Raises:
        KeyError: D-SI has no such unit.
    """
    values = {"unit": UNITS[unit], "expanded": ""}
    if not expanded:
        # Four decimals of a millimetre, as on paper; six digits of anything else.
        decimals = 4 if unit in ("mm", "C") else _decimals(value, 6)
        text = str(value) if isinstance(value, int) else f"{value:.{decimals}f}"
        return values | {"value": text}
    decimals = _decimals(expanded, 2)
    return values | {
        "value": f"{value:.{decimals}f}",
        "expanded": f"{expanded:.{decimals}f}",
        "coverage_factor": f"{coverage_factor:.4g}",
        "probability": f"{probability or erf(coverage_factor / sqrt(2.0)):.4f}",
    }


def _decimals(number: float, digits: int) -> int:
    if number == 0.0:
        return digits
    return min(max(digits - 1 - floor(log10(abs(number))), 0), _MOST_DECIMALS)


def _line(text: str) -> str:
    """Put a text into one line without spaces around it; escaped stays escaped."""
    return type(text)(" ".join(text.split()))


_FILTERS: Filters = {"quantity": quantity, "line": _line}


def certificate_text(
    kind: Literal["verification", "identification"],
    values: Mapping[str, Any],
    administration: Mapping[str, Any],
    digest: str,
    **stated: object,
) -> str:
    """Write the certificate of the values of a `certificate.json` or identification.

    The digest is of the arm file's values; stated are `laboratory`, `issued`, `files`.

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


def evidence_files(folder: Path) -> tuple[str, ...]:
    """Name the files of a folder that its certificate refers to."""
    pages = PAGES if (folder / CERTIFICATE).is_file() else IDENTIFICATION_FILES
    data = sorted(path for path in (folder / DATA).glob("*") if path.is_file())
    return (*pages, *(f"{DATA}/{path.name}" for path in data))


def evidence_text(folder: Path, laboratory: Laboratory, issued: date) -> str:
    """Write the certificate of a folder of results, as XML.

    Raises:
        FileError: It is none, or states too little or too early to be certified.
    """
    stated: dict[str, Any] = {
        "laboratory": laboratory.model_dump(),
        "issued": issued.isoformat(),
        "files": sums_of(folder, evidence_files(folder)),
    }
    try:
        if (folder / CERTIFICATE).is_file():
            values = _values(folder / CERTIFICATE)
            about = values["administration"], values["arm"]["digest"]
            refuse_early_issue(issued, about[0]["measured_to_utc"])
            return certificate_text("verification", values, *about, **stated)
        values = _values(folder / IDENTIFICATION)
        arm = read_arm(folder / _ARM)
        campaign = _campaign(folder, arm)
        measured = measured_campaign(campaign, arm, campaign.artefacts)
        administration = administration_of([measured], arm, NO_LIMITS)
        refuse_early_issue(issued, administration.measured_to_utc)
        about = plain_values(administration), arm_digest(arm)
        return certificate_text("identification", values, *about, **stated)
    except FileError:
        raise
    except (KeyError, TypeError, MissingValueError) as error:
        lacks = f"has no {str(error).rpartition(' ')[2]}"
        if isinstance(error, TypeError):
            lacks = f"has a value of the wrong type ({error})"
        message = f"{lacks}; make the results again with this version of Traverse"
        raise FileError(folder, message) from error
    except ValueError as error:
        raise FileError(folder, str(error)) from error


def laboratory_on_page(folder: Path) -> dict[str, Any] | None:
    """Return what a verification states of its laboratory, if anything."""
    path = folder / CERTIFICATE
    return _values(path).get("laboratory") if path.is_file() else None


def _values(path: Path) -> dict[str, Any]:
    try:
        values = json_of(path)
    except (OSError, ValueError) as error:
        message = "is no folder of `traverse verify --out` or `traverse identify --out`"
        raise FileError(path.parent, f"{message}: {error}") from error
    if not isinstance(values, dict):
        raise FileError(path, "is no table of results")
    return values


def add_data(folder: Path, campaign: Path, design: Path) -> None:
    """Copy what an identification was made of beside its results.

    Raises:
        FileError: The campaign's files do not lie beside one another.
    """
    (folder / DATA).mkdir(exist_ok=True)
    for path in files_read(campaign):
        shutil.copyfile(path, folder / DATA / path.name)
    shutil.copyfile(design, folder / DATA / _DESIGN)


def _campaign(folder: Path, arm: Arm) -> Campaign:
    names = [joint.name for joint in arm.joints]
    return read_campaign(folder / DATA, names, several_tools=True, orientations=True)


def evidence_problems(folder: Path) -> Iterator[str]:
    """Compute everything again and name what does not follow from the raw data."""
    if (folder / CERTIFICATE).is_file():
        yield from certificate_problems(folder)
        return
    values = _values(folder / IDENTIFICATION)
    inputs = values.get("inputs")
    if values.get("schema") != SCHEMA or not isinstance(inputs, dict):
        yield f"{IDENTIFICATION} does not say what it was made of; identify again"
        return
    for key, message in _NOT_ALONE.items():
        if values.get(key) is not None:
            yield message
            return
    design = read_arm(folder / DATA / _DESIGN)
    if arm_digest(design) != inputs.get("arm_digest"):
        yield f"{DATA}/{_DESIGN} is not the arm file that was identified from"
        return
    campaign = _campaign(folder, design)
    if campaign.digest != values["provenance"]["campaign"]["sha256"]:
        yield f"the campaign in {DATA} is not the one that was identified from"
        return
    options = Options(hold=tuple(inputs["hold"]), free=tuple(inputs["free"]))
    try:
        result = identify(campaign, design, options)
    except IdentificationError as error:
        yield f"cannot be computed again: {error}"
        return
    yield from _result_problems(folder, values, result)


def _result_problems(
    folder: Path, values: Mapping[str, Any], result: Identification
) -> Iterator[str]:
    """Compare what is stated with a result that was computed again."""
    again = json.loads(json.dumps(identification_json(result)))
    yield from differences(_compared(values), _compared(again))
    digest = digest_of_files([folder / COVARIANCE_FILE])
    expected = identified_arm(result, datetime.now(UTC), digest)
    for line in differences(_values_of(read_arm(folder / _ARM)), _values_of(expected)):
        yield f"{_ARM}: {line}"
    cartesian = result.cartesian
    try:
        known = read_arm_covariance(folder / COVARIANCE_FILE, cartesian.names, digest)
    except ValueError as error:
        yield str(error)
        return
    scale = np.sqrt(np.diag(cartesian.covariance))
    off = np.abs(known.covariance - cartesian.covariance)
    if not (off <= 1e-6 * np.outer(scale, scale) + 1e-15).all():
        yield f"{COVARIANCE_FILE} does not follow from the data"


def _compared(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values[name] for name in values if name not in _NOT_COMPARED}


def _values_of(arm: Arm) -> dict[str, Any]:
    """The arm without the date of its identification."""
    values = arm.model_dump(by_alias=True)
    values["identification"] = {**(values["identification"] or {}), "date": None}
    return values

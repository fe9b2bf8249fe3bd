"""Evidence that is certified: a folder of a verification or of an identification.

Its figures are computed again from the raw data in it before anything is signed, and
whenever a certificate is checked.
"""

import json
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, arm_digest, read_arm
from traverse.kinematics.uncertainty.arm_covariance import read_arm_covariance
from traverse.lab.acceptance.certificate.administration import administration_of
from traverse.lab.acceptance.certificate.check import (
    CERTIFICATE,
    DATA,
    PAGES,
    certificate_problems,
)
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.certificates.document import (
    identification_document,
    verification_document,
)
from traverse.lab.identification.identify import IdentificationError, Options, identify
from traverse.lab.identification.results.files import (
    COVARIANCE_FILE,
    IDENTIFICATION,
    IDENTIFICATION_FILES,
    SCHEMA,
    identification_json,
    identified_arm,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.measured_points.reading import files_read, read_measured
from traverse.lab.report.differences import differences
from traverse.lab.report.provenance import digest_of_files
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError, Problem

LABORATORY = "laboratory.toml"
_DESIGN = "design.toml"
_ARM = "arm.toml"
# Neither figures nor data: when, by whom and how it was computed, and advice.
_NOT_ALONE = {
    "holdout": "a part of the poses was kept aside; identify with all of them",
    "family": "what its family says took part; identify from its own poses alone",
}
_NOT_COMPARED = ("provenance", "iterations", "suggestions", "holdout")


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a folder has to be certified.

    Attributes:
        document: Values of the template, but for the laboratory's.
        files: Names of the files that the certificate refers to.
    """

    document: Mapping[str, Any]
    files: tuple[str, ...]


def read_evidence(folder: Path) -> Evidence:
    """Read a folder of results.

    Raises:
        FileError: It is none, or states too little to be certified.
    """
    data = tuple(
        f"{DATA}/{path.name}"
        for path in sorted((folder / DATA).glob("*"))
        if path.is_file()
    )
    try:
        if (folder / CERTIFICATE).is_file():
            values = _values(folder / CERTIFICATE)
            return Evidence(verification_document(values), (*PAGES, *data))
        values = _values(folder / IDENTIFICATION)
        arm = read_arm(folder / _ARM)
        measured = read_measured(folder / DATA, arm)
        document = identification_document(
            values, administration_of([measured], arm), arm_digest(arm)
        )
    except (KeyError, TypeError) as error:
        told = f"has no {error}; make the results again with this version of Traverse"
        raise FileError(str(folder), [Problem("", told)]) from error
    except ValueError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(str(folder), [Problem("", str(error))]) from error
    return Evidence(document, (*IDENTIFICATION_FILES, *data))


def _values(path: Path) -> dict[str, Any]:
    try:
        values = json_of(path)
    except (OSError, ValueError) as error:
        told = "is no folder of `traverse verify --out` or `traverse identify --out`"
        raise FileError(str(path.parent), [Problem("", f"{told}: {error}")]) from error
    if not isinstance(values, dict):
        raise FileError(str(path), [Problem("", "is no table of results")])
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
    for key, told in _NOT_ALONE.items():
        if values.get(key) is not None:
            yield told
            return
    design = read_arm(folder / DATA / _DESIGN)
    if arm_digest(design) != inputs.get("arm_digest"):
        yield f"{DATA}/{_DESIGN} is not the arm file that was identified from"
        return
    names = [joint.name for joint in design.joints]
    campaign = read_campaign(folder / DATA, names, several_tools=True)
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
    found = result.cartesian
    try:
        known = read_arm_covariance(folder / COVARIANCE_FILE, found.names, digest)
    except ValueError as error:
        yield str(error)
        return
    scale = np.sqrt(np.diag(found.covariance))
    off = np.abs(known.covariance - found.covariance)
    if not (off <= 1e-6 * np.outer(scale, scale) + 1e-15).all():
        yield f"{COVARIANCE_FILE} does not follow from the data"


def _compared(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values[name] for name in values if name not in _NOT_COMPARED}


def _values_of(arm: Arm) -> dict[str, Any]:
    """The arm without the date of its identification."""
    values = arm.model_dump(by_alias=True)
    values["identification"] = {**(values["identification"] or {}), "date": None}
    return values

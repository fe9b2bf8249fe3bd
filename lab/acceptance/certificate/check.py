"""Checking a certificate: its digests, and whether its figures follow from its data."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.administration import administration_of
from traverse.lab.acceptance.certificate.comparison import (
    AS_FOUND,
    PREVIOUS,
    read_before,
)
from traverse.lab.acceptance.certificate.digests import digest_values, read_values
from traverse.lab.acceptance.certificate.values import (
    PREDICTED,
    SealedCertificate,
    result_values,
)
from traverse.lab.acceptance.laboratory import Laboratory
from traverse.lab.acceptance.limits import NO_LIMITS, Limits
from traverse.lab.acceptance.standards import STANDARDS, verified
from traverse.lab.measured_points.reading import files_read, read_by_tool
from traverse.lab.report.provenance import (
    ReportSource,
    digest_of_files,
    report_provenance,
    sums_problems,
)
from traverse.lab.report.quantities import differences
from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.reader import read_strict

# When, by whom and with what it was computed.
_NOT_COMPARED = ("date_utc", "provenance")
CERTIFICATE = "certificate.json"
PAGES = (CERTIFICATE, "certificate.html", "certificate.pdf")
ARM, LIMITS, LABORATORY = "arm.toml", "limits.toml", "laboratory.toml"
DATA = "data"


def certificate_problems(path: Path) -> list[str]:
    """Return everything that is wrong with a certificate; empty where nothing is.

    The path is that of the certificate's folder, or of `certificate.json` in it.

    Raises:
        FileError: It is no certificate.
    """
    file = path / CERTIFICATE if path.is_dir() else path
    values = read_values(file)
    folder = file.parent / DATA
    stated = values.pop("digest")
    return (
        list(_digest_problems(values, stated, folder))
        or list(sums_problems(file.parent, PAGES))
        or list(_figure_problems(values, folder))
    )


def _digest_problems(
    values: Mapping[str, Any], stated: Mapping[str, Any], folder: Path
) -> Iterator[str]:
    files: dict[str, str] = {}
    for name, digest in stated["files"].items():
        path = folder / str(name)
        if not path.is_file():
            yield f"{DATA}/{name} is missing"
            continue
        files[name] = hashlib.sha256(bytes_of(path)).hexdigest()
        if files[name] != digest:
            yield f"{DATA}/{name} was changed: its digest is not the one stated"
    digests = digest_values(values, dict(stated["files"]))
    if digests["result"] != stated.get("result"):
        yield "the figures were changed: their digest is not that of the certificate"
    if digests["digest"] != stated.get("digest"):
        yield "the digest over all is not that of the certificate"


def _figure_problems(values: Mapping[str, Any], folder: Path) -> Iterator[str]:
    """Compute everything again from the data of the certificate."""
    standard = str(values.get("standard"))
    if standard not in STANDARDS:
        yield f"standard {standard!r} is not known here"
        return
    file = folder / LIMITS
    limits = read_strict(file, Limits) if file.is_file() else NO_LIMITS
    laboratory = None
    if "laboratory" in values:
        laboratory = read_strict(folder / LABORATORY, Laboratory)
    recordings = sorted(folder.glob("*.mcap"))
    has_campaign = (folder / "campaign.toml").is_file()
    data = folder if has_campaign or not recordings else recordings[0]
    arm = read_arm(folder / ARM)
    # Certificates without a prediction may lack the covariance that the arm file names.
    measured = read_by_tool(data, arm, folder / ARM if PREDICTED in values else None)
    again = SealedCertificate(
        verified(measured, standard, limits),
        arm,
        limits,
        {},
        administration_of(measured, arm, limits),
        report_provenance(
            ReportSource(data.name, digest_of_files(files_read(data))),
            when=datetime.fromisoformat(values["date_utc"]),
        ),
        read_before(
            data,
            standard,
            limits,
            arm,
            as_found=_there(folder / AS_FOUND),
            previous=_there(folder / PREVIOUS),
        ),
        laboratory,
    )
    computed = json.loads(json.dumps(result_values(again)))
    stated = dict(values)
    for name in _NOT_COMPARED:
        source = (computed.pop(name, None), stated.pop(name, None))
        if name == "provenance" and not _same_campaign(*source):
            yield "the campaign is not the one that its provenance names"
        elif name == "provenance" and not _same_draws(*source):
            computed["figures"], stated["figures"] = (
                [_without_draws(figure) for figure in side["figures"]]
                for side in (computed, stated)
            )
    yield from differences(stated, computed)


def _there(path: Path) -> Path | None:
    return path if path.is_file() else None


def _same_campaign(computed: Any, stated: Any) -> bool:  # noqa: ANN401 - of a file
    try:
        return bool(computed["campaign"]["sha256"] == stated["campaign"]["sha256"])
    except (KeyError, TypeError):
        return False


def _same_draws(computed: Mapping[str, Any], stated: Mapping[str, Any]) -> bool:
    """Whether numpy draws the same from the same seed, as one version of it does."""
    versions = stated.get("versions")
    of_numpy = versions.get("numpy") if isinstance(versions, dict) else None
    return bool(computed["versions"]["numpy"] == of_numpy)


def _without_draws(figure: object) -> object:
    if not isinstance(figure, dict):
        return figure
    return {key: value for key, value in figure.items() if key != "monte_carlo"}

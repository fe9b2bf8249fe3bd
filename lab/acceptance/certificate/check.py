"""Checking a certificate: its digests, and whether its figures follow from its data."""

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.certificate.administration import administration_of
from traverse.lab.acceptance.certificate.values import SCHEMA, digest_values
from traverse.lab.acceptance.conformity.limits import NO_LIMITS, read_limits
from traverse.lab.acceptance.standards import STANDARDS, verified
from traverse.lab.measured_points.reading import read_measured
from traverse.strict_toml.files import bytes_of, json_of
from traverse.strict_toml.problems import FileError, Problem

_SAME_MM = 1e-9
ARM, LIMITS = "arm.toml", "limits.toml"
DATA = "data"


def certificate_problems(path: Path) -> list[str]:
    """Return everything that is wrong with a certificate; empty where nothing is.

    The path is that of the certificate's folder, or of `certificate.json` in it.

    Raises:
        FileError: It is no certificate.
    """
    file = path / "certificate.json" if path.is_dir() else path
    values = _read(file)
    folder = file.parent / DATA
    stated = values.pop("digest")
    problems = list(_digest_problems(values, stated, folder))
    if not problems:
        problems = list(_figure_problems(values, folder))
    return problems


def _read(file: Path) -> dict[str, Any]:
    try:
        values = json_of(file)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileError(
            str(file), [Problem("", f"cannot be read: {reason}; check the path")]
        ) from error
    except ValueError as error:
        raise FileError(str(file), [Problem("", f"is not JSON: {error}")]) from error
    is_ours = isinstance(values, dict) and values.get("schema") == SCHEMA
    stated = values.get("digest") if is_ours else None
    if not isinstance(stated, dict) or not isinstance(stated.get("files"), dict):
        raise FileError(
            str(file), [Problem("", f"is no certificate: expected the schema {SCHEMA}")]
        )
    return dict(values)


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
    found = digest_values(values, dict(stated["files"]))
    if found["result"] != stated.get("result"):
        yield "the figures were changed: their digest is not that of the certificate"
    if found["digest"] != stated.get("digest"):
        yield "the digest over all is not that of the certificate"


def _figure_problems(values: Mapping[str, Any], folder: Path) -> Iterator[str]:
    """Compute everything again from the data of the certificate."""
    if values.get("standard") not in STANDARDS:
        yield f"standard {values.get('standard')!r} is not known here"
        return
    limits = folder / LIMITS
    recordings = sorted(folder.glob("*.mcap"))
    has_campaign = (folder / "campaign.toml").is_file()
    data = folder if has_campaign or not recordings else recordings[0]
    arm = read_arm(folder / ARM)
    measured = read_measured(data, arm)
    administration = administration_of(measured, arm)
    if values.get("administration", administration) != administration:
        yield "operator, dates, temperature or standards are not those of the data"
    again = verified(
        measured,
        str(values["standard"]),
        read_limits(limits) if limits.is_file() else NO_LIMITS,
    )
    stated = {figure["key"]: figure for figure in values["figures"]}
    if set(stated) != {figure.key for figure in again.figures}:
        yield "the data give other figures than the certificate"
        return
    for figure in again.figures:
        value_mm = float(stated[figure.key]["value_mm"])
        if not abs(value_mm - figure.value_mm) <= _SAME_MM:
            yield (
                f"{figure.name}: the data give {figure.value_mm:.6f} mm, the "
                f"certificate says {value_mm:.6f} mm"
            )
        verdict = None if figure.decision is None else figure.decision.verdict
        if verdict != stated[figure.key]["verdict"]:
            yield (
                f"{figure.name}: the data give {verdict}, the certificate says "
                f"{stated[figure.key]['verdict']}"
            )

"""Statements of a certificate besides figures: who, where, when, which standards."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, arm_digest
from traverse.lab.acceptance.conformity import (
    PREDICTED_FACTOR,
    Figure,
    LengthError,
    Limits,
    PredictedLengths,
    Verification,
)
from traverse.lab.artefacts import Artefact
from traverse.lab.measured_points.measurement import Measurement
from traverse.lab.outcomes.acceptance import (
    AcceptanceEvidence,
    DecidedFigure,
    acceptance_outcome,
)
from traverse.lab.outcomes.base import outcome_json
from traverse.lab.report.provenance import ReportProvenance, utc_text
from traverse.lab.report.quantities import picked, plain_values


def administration_of(measured: Sequence[Measurement], arm: Arm) -> dict[str, Any]:
    """Collect what campaign and arm file state, as plain values.

    Times are ISO 8601 with Z, of the first and the last touch; temperatures are those
    of all touches. None stands where something is not stated. There are `tools` where
    the campaign names any.
    """
    occasion = measured[0].occasion
    firsts = [
        at
        for measurement in measured
        if (at := measurement.occasion.first_utc) is not None
    ]
    lasts = [
        at
        for measurement in measured
        if (at := measurement.occasion.last_utc) is not None
    ]
    warm_c = np.concatenate([measurement.temperature_c for measurement in measured])
    known = bool(len(warm_c))
    identified = arm.identification and arm.identification.date
    touched = {
        name: artefact
        for name, artefact in measured[0].artefacts.items()
        if any(len(measurement.of(name)) for measurement in measured)
    }
    tools = [
        {
            "name": measurement.tool.name,
            "vector_mm": list(measurement.tool.vector_mm or ()),
        }
        for measurement in measured
        if measurement.tool is not None
    ]
    return {
        "operator": occasion.operator,
        "place": occasion.place,
        "measured_from_utc": utc_text(min(firsts)) if firsts else None,
        "measured_to_utc": utc_text(max(lasts)) if lasts else None,
        "temperature_least_c": float(warm_c.min()) if known else None,
        "temperature_mean_c": float(warm_c.mean()) if known else None,
        "temperature_largest_c": float(warm_c.max()) if known else None,
        "arm_name": arm.name,
        "arm_serial_number": arm.serial_number,
        "arm_calibration_date": str(identified) if identified else None,
        "standards": _standards(touched),
        **({"tools": tools} if tools else {}),
    }


def _standards(artefacts: Mapping[str, Artefact]) -> list[dict[str, Any]]:
    """Name each standard once, however many places it was touched in."""
    standards: dict[tuple[str | None, ...], dict[str, Any]] = {}
    for name, artefact in artefacts.items():
        if artefact.kind in ("cone", "plane"):
            continue  # not calibrated
        calibrated = artefact.calibration_date
        stated: dict[str, Any] = {
            "kind": artefact.kind,
            "artefacts": [],
            "serial_number": artefact.serial_number,
            "calibration_date": None if calibrated is None else calibrated.isoformat(),
            "certificate_number": artefact.certificate_number,
        }
        identity = tuple(text for key, text in stated.items() if key != "artefacts")
        standards.setdefault(identity, stated)["artefacts"].append(name)
    return list(standards.values())


SCHEMA = "traverse/acceptance/1"
ALGORITHM = "SHA-256"
PREDICTED = "predicted_by_arm"


@dataclass(frozen=True, slots=True, eq=False)
class SealedCertificate:
    """A verification with everything that it was made of.

    Attributes:
        limits: As read, or none.
        files: Contents of the files, by the names that they get in the folder `data`.
        administration: Who measured, where, when, with which standards, as values.
    """

    verification: Verification
    arm: Arm
    limits: Limits
    files: Mapping[str, bytes]
    administration: Mapping[str, Any]
    provenance: ReportProvenance

    @property
    def values(self) -> dict[str, Any]:
        """The certificate with its digest."""
        result = result_values(self)
        files = {
            name: hashlib.sha256(content).hexdigest()
            for name, content in sorted(self.files.items())
        }
        return {**result, "digest": digest_values(result, files)}


def result_values(certificate: SealedCertificate) -> dict[str, Any]:
    """Put everything but the digest into plain values."""
    verification, limits = certificate.verification, certificate.limits
    judged = acceptance_outcome(
        AcceptanceEvidence(
            [_decided(figure) for figure in verification.figures],
            [entry["name"] for entry in plain_values(verification.missing)],
        )
    )
    predicted = {}
    if verification.predicted is not None:
        predicted[PREDICTED] = _predicted(verification.predicted, verification.lengths)
    return {
        "schema": SCHEMA,
        "standard": verification.standard,
        "title": verification.title,
        "date_utc": certificate.provenance.date_utc,
        "provenance": certificate.provenance.values,
        "administration": dict(certificate.administration),
        "arm": {"name": certificate.arm.name, "digest": arm_digest(certificate.arm)},
        **outcome_json(judged.outcome),
        "conclusion": judged.title,
        "sentences": list(judged.sentences),
        "verdict": verification.verdict,
        "complete": not verification.missing,
        "decision": picked(limits, "guard_factor", "coverage_factor", rule="decision"),
        "figures": [_figure(figure, limits) for figure in verification.figures],
        "missing": plain_values(verification.missing),
        "lengths": [_of_tool(asdict(error)) for error in verification.lengths],
        "scatters": plain_values(verification.scatters),
        **predicted,
        "remarks": list(verification.remarks),
    }


def _decided(figure: Figure) -> DecidedFigure:
    decision = figure.decision
    return DecidedFigure(
        figure.name,
        figure.value_mm,
        decision.limit_mm if decision else None,
        decision.verdict if decision else None,
        tuple(figure.remarks),
    )


def _predicted(
    lengths: PredictedLengths, errors: Sequence[LengthError]
) -> dict[str, Any]:
    return {
        "coverage_factor": PREDICTED_FACTOR,
        **picked(lengths, "sigma0", "p_value", "explains", inside="n_inside"),
        "lengths": [
            {"artefact": error.artefact, "repeat": error.repeat, "standard_mm": std_mm}
            for error, std_mm in zip(errors, lengths.stds_mm, strict=True)
        ],
    }


def digest_values(
    result: Mapping[str, Any], files: Mapping[str, str]
) -> dict[str, Any]:
    """Return the digests of files and result, and the one over both."""
    of_result = hashlib.sha256(canonical(result)).hexdigest()
    both = {"files": dict(files), "result": of_result}
    whole = hashlib.sha256(canonical(both)).hexdigest()
    return {"algorithm": ALGORITHM, **both, "digest": whole}


def canonical(values: Mapping[str, Any]) -> bytes:
    """Write values in the one way that is hashed: sorted keys, no spaces, UTF-8."""
    text = json.dumps(
        values,
        sort_keys=True,
        separators=(",", ":"),
        allow_nan=False,
        ensure_ascii=False,
    )
    return text.encode()


def _of_tool(values: dict[str, Any]) -> dict[str, Any]:
    """Leave the tool out where there is none, as certificates were before."""
    return {k: v for k, v in values.items() if k != "tool" or v is not None}


def _figure(figure: Figure, limits: Limits) -> dict[str, Any]:
    decision, standard_mm = figure.decision, figure.budget.standard_mm
    values = {
        **picked(figure, "key", "name", "definition", "source", "confirm", "value_mm"),
        "expanded_uncertainty_mm": None
        if standard_mm is None
        else limits.coverage_factor * standard_mm,
        "budget": [asdict(line) for line in figure.budget.lines],
        **dict.fromkeys(("limit_mm", "guard_mm", "rule", "verdict")),
        **(asdict(decision) if decision else {}),
        "parts": [{"name": name, "value_mm": value} for name, value in figure.parts],
        "remarks": list(figure.remarks),
        "tool": figure.tool,
    }
    return _of_tool(values)

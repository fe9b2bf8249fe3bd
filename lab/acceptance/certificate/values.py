"""A certificate as plain values, with its digests."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from traverse.kinematics.arm_file.arm import Arm, arm_digest
from traverse.lab.acceptance.administration import Administration
from traverse.lab.acceptance.budget import correlation, coverage_factor
from traverse.lab.acceptance.certificate.comparison import (
    NOTHING_BEFORE,
    Before,
    comparison_values,
)
from traverse.lab.acceptance.certificate.digests import SCHEMA, digest_values
from traverse.lab.acceptance.conformity import (
    PREDICTED_FACTOR,
    Figure,
    LengthError,
    PredictedLengths,
    Verification,
)
from traverse.lab.acceptance.laboratory import Laboratory, refuse_early_issue
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.monte_carlo import propagated
from traverse.lab.acceptance.statements import absent_statements, required_statements
from traverse.lab.outcomes.acceptance import (
    VERDICT_WORDS,
    AcceptanceEvidence,
    DecidedFigure,
    acceptance_outcome,
)
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.quantities import picked, plain_values

PREDICTED = "predicted_by_arm"


@dataclass(frozen=True, slots=True, eq=False)
class SealedCertificate:
    """A verification with everything that it was made of.

    Attributes:
        files: Contents of the files, by the names that they get in the folder `data`.
    """

    verification: Verification
    arm: Arm
    limits: Limits
    files: Mapping[str, bytes]
    administration: Administration
    provenance: ReportProvenance
    before: Before = NOTHING_BEFORE
    laboratory: Laboratory | None = None

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
    stated, standard = certificate.administration, verification.standard
    absent = absent_statements(standard, stated, certificate.provenance.date_utc)
    judged = acceptance_outcome(
        AcceptanceEvidence(
            [_decided(figure) for figure in verification.figures],
            [lacking.name for lacking in verification.missing],
            absent,
            verification.contradictions,
        )
    )
    predicted = {}
    if verification.predicted is not None:
        predicted[PREDICTED] = _predicted(verification.predicted, verification.lengths)
    figures = [
        _figure(figure, verdict, limits)
        for figure, verdict in zip(verification.figures, judged.verdicts, strict=True)
    ]
    return {
        "schema": SCHEMA,
        "standard": standard,
        "title": verification.title,
        "date_utc": certificate.provenance.date_utc,
        "provenance": certificate.provenance.values,
        "administration": plain_values(stated),
        **_stated_by(certificate.laboratory, stated.measured_to_utc),
        "statements": {
            "required": [entry.code for entry in required_statements(standard)],
            "absent": plain_values(absent),
        },
        "arm": {"name": certificate.arm.name, "digest": arm_digest(certificate.arm)},
        **plain_values(judged.outcome),
        "conclusion": judged.title,
        "sentences": list(judged.sentences),
        "verdict": judged.verdict,
        "complete": not verification.missing,
        "decision": picked(
            limits, "guard_factor", "coverage_probability", rule="decision"
        ),
        "figures": figures,
        **comparison_values(
            certificate.before,
            figures,
            stated.measured_to_utc,
            withheld=judged.verdict == "withheld",
        ),
        "missing": plain_values(verification.missing),
        "lengths": [_length(error) for error in verification.lengths],
        "length_correlation": _correlation(verification.lengths),
        "scatters": plain_values(verification.scatters),
        **predicted,
        "remarks": list(verification.remarks),
    }


def _stated_by(
    laboratory: Laboratory | None, measured_to_utc: str | None
) -> dict[str, Any]:
    if laboratory is None:
        return {}
    refuse_early_issue(laboratory.issued, measured_to_utc)
    return {"laboratory": laboratory.plain_values}


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


def _of_tool(values: dict[str, Any]) -> dict[str, Any]:
    """Leave the tool out where there is none, as certificates were before."""
    return {k: v for k, v in values.items() if k != "tool" or v is not None}


def _length(error: LengthError) -> dict[str, Any]:
    names = ("artefact", "repeat", "length_mm", "error_mm", "limit_mm", "standard_mm")
    return _of_tool(picked(error, *names, "role", "tool"))


def _correlation(errors: Sequence[LengthError]) -> dict[str, Any]:
    """Correlate errors of the standards, of each with itself in another place."""
    by_source: dict[str, list[LengthError]] = {}
    for error in errors:
        by_source.setdefault(error.budget.lines[0].source, []).append(error)
    firsts = [of_source[0].budget for of_source in by_source.values()]
    coefficients = correlation(firsts)
    for row, of_source in enumerate(by_source.values()):
        ends = [of_source[0].budget, of_source[-1].budget]
        coefficients[row, row] = correlation(ends)[0, 1]
    return {"of": list(by_source), "coefficients": plain_values(coefficients)}


def _figure(figure: Figure, verdict: str | None, limits: Limits) -> dict[str, Any]:
    decision, budget = figure.decision, figure.budget
    probability = limits.coverage_probability
    standard_mm, with_arm_mm = budget.standard_mm, budget.with_arm_mm
    factor = budget.coverage_factor(probability)
    expanded_mm = None if standard_mm is None else factor * standard_mm
    checked = None
    if expanded_mm:
        size_mm = abs(figure.value_mm)
        checked = propagated(figure.model, size_mm, expanded_mm, probability)
    values = {
        **picked(figure, "key", "name", "definition", "source", "confirm", "value_mm"),
        "expanded_uncertainty_mm": expanded_mm,
        "coverage_factor": factor,
        "degrees": plain_values(budget.degrees),
        "expanded_with_arm_mm": None
        if with_arm_mm is None
        else coverage_factor(budget.degrees_with_arm, probability) * with_arm_mm,
        "budget": [
            picked(line, "name", "formula", "standard_mm", "evaluation", "degrees")
            | picked(line, "source", "of_arm")
            for line in budget.lines
        ],
        "monte_carlo": plain_values(checked),
        **dict.fromkeys(("limit_mm", "guard_mm", "rule")),
        **(asdict(decision) if decision else {}),
        "limit_over_uncertainty": decision.limit_mm / expanded_mm
        if decision and expanded_mm
        else None,
        "verdict": verdict,
        "decision": VERDICT_WORDS[verdict],
        "parts": [{"name": name, "value_mm": value} for name, value in figure.parts],
        "remarks": list(figure.remarks),
        "tool": figure.tool,
    }
    return _of_tool(values)

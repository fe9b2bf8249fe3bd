"""Files of a diagnosis: arm, diagnosis.json, discrepancies.csv, page, pictures."""

import json
import re
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, arm_digest, parse_arm
from traverse.kinematics.arm_file.arm import Identification as Provenance
from traverse.lab.adjustment import IteratedAdjustment
from traverse.lab.campaign.prior import family_json
from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.fit import has_epoch, terms_without_epoch
from traverse.lab.diagnosis.model.outcome import outcome_of
from traverse.lab.diagnosis.model.result import (
    Detectable,
    Diagnosis,
    HoldoutResult,
    Step,
    Term,
    closed,
)
from traverse.lab.diagnosis.report.discrepancies import write_discrepancies
from traverse.lab.diagnosis.report.page import report_page
from traverse.lab.diagnosis.report.pictures import plots_of
from traverse.lab.outcomes.adjustment import (
    COVARIANCE_FILE,
    CartesianCovariance,
    write_covariance,
)
from traverse.lab.outcomes.base import outcome_json
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.quantities import picked, plain_values
from traverse.lab.statistics.distributions import global_test, variance_factor
from traverse.strict_toml.arm_text import arm_text
from traverse.strict_toml.files import bytes_of, text_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import replacing, write_atomically

SCHEMA = "traverse/diagnosis/1"

# Smaller p-values are no numbers any more.
_LEAST_LOG10_P = -300.0
_TERM_PICTURE = re.compile(r"term-\d+\.png")


def write_diagnosis(
    folder: str | Path,
    diagnosis: Diagnosis,
    source: str | Path,
    when: datetime | None = None,
    provenance: ReportProvenance | None = None,
) -> Arm:
    """Write everything into a folder, which is made if need be.

    The comments of the source, the arm file that was diagnosed, are kept. Date and
    provenance are by default those of now. Returns the adapted arm as written, with its
    provenance.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    cartesian = covariance_of(diagnosis.final)
    digest = write_covariance(cartesian, target / COVARIANCE_FILE)
    arm = arm_with_provenance(diagnosis, when, digest)
    write_adapted(target / "arm.toml", arm, Path(source))
    origin = provenance or diagnosis.campaign.provenance(when=when)
    values = diagnosis_json(diagnosis, origin)
    text = json.dumps(values, indent=1, allow_nan=False)
    write_atomically(target / "diagnosis.json", text + "\n")
    plots = plots_of(diagnosis)
    parts = pose_parts(diagnosis)
    write_discrepancies(target / "discrepancies.csv", plots.before, plots.after, parts)
    for name, png in plots.files.items():
        (target / name).write_bytes(png)
    # Terms of an earlier diagnosis in this folder would be taken for ours.
    for path in target.glob("term-*.png"):
        if _TERM_PICTURE.fullmatch(path.name) and path.name not in plots.files:
            path.unlink()
    write_atomically(target / "report.html", report_page(diagnosis, plots, origin))
    return arm


def diagnosis_json(
    diagnosis: Diagnosis, provenance: ReportProvenance | None = None
) -> dict[str, Any]:
    """Put a diagnosis into the plain values of `diagnosis.json`."""
    lines = diagnosis.campaign.poses.lines
    noise, ids = (
        diagnosis.noise,
        [artefact.id for artefact in diagnosis.campaign.artefacts],
    )
    unwritten = terms_without_epoch(diagnosis)
    masses = diagnosis.all_terms.mass_distribution()
    values = {
        "schema": SCHEMA,
        "provenance": (provenance or diagnosis.campaign.provenance()).values,
        "verdict": diagnosis.verdict,
        **outcome_json(outcome_of(diagnosis)),
        "visible": {"n": diagnosis.n_visible, "of": diagnosis.n_library},
        "terms": [
            _term(term, written=term.accepted and term not in unwritten)
            for term in diagnosis.terms
        ],
        "sigma0": {
            "before": diagnosis.before.sigma0,
            "after": diagnosis.after.sigma0,
        },
        "gap": _gap(diagnosis),
        "excluded": _excluded(diagnosis),
        "orientations": {
            "excluded": [{"line": n} for n in lines[diagnosis.turned].tolist()]
        },
        "detectable": detectable_json(diagnosis.detectable),
        "ledger": [_ledger_line(step) for step in diagnosis.ledger],
        "vetoed": diagnosis.vetoed,
        "times_stated_noise": diagnosis.exceeded,
        "identified_anew": diagnosis.is_identified_anew,
        "leftovers": [
            {
                "bank": left.bank.name.lower(),
                **_identity(left.candidate),
                **picked(left, "log10_p", "threshold_log10_p"),
            }
            for left in diagnosis.leftovers
        ],
        "noise": {
            **asdict(noise),
            "contact_mm": dict(zip(ids, noise.contact_mm, strict=True)),
        },
        "seed": diagnosis.seed,
        "holdout_by": diagnosis.holdout_by,
        **family_json(diagnosis.campaign.prior),
        **({"mass_distribution": masses} if masses else {}),
    }
    if diagnosis.campaign.tools:
        vectors_mm = diagnosis.after.state.arm.tools_mm
        values["tools"] = {
            tool.name: {"vector_mm": vector_mm.tolist()}
            for tool, vector_mm in zip(
                diagnosis.campaign.tools, vectors_mm, strict=True
            )
        }
    plain: dict[str, Any] = plain_values(values)
    return plain


def detectable_json(detectable: Sequence[Detectable]) -> list[dict[str, Any]]:
    """Put minimal detectable sizes into plain values."""
    values = [
        {
            **_identity(entry.candidate),
            "key": entry.key,
            "minimum": _size(entry.minimum, entry.unit),
            "best": _size(entry.best, entry.unit),
            "probe_mm": entry.probe_mm,
            "why": entry.why or None,
        }
        for entry in detectable
    ]
    plain: list[dict[str, Any]] = plain_values(values)
    return plain


def pose_parts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what became of each pose: choosing, held_out, excluded or final."""
    parts = np.where(diagnosis.choosing, "choosing", "final")
    parts = np.where(diagnosis.held_out, "held_out", parts)
    parts = np.where(diagnosis.excluded, "excluded", parts)
    return tuple(parts.tolist())


def _excluded(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """List the poses that took no part, in choosing or in the last estimates."""
    lines, w = diagnosis.campaign.poses.lines, diagnosis.final.statistics.w
    rows = np.flatnonzero(diagnosis.excluded | diagnosis.left_out)
    return [
        {
            "line": int(lines[at]),
            "choosing": bool(diagnosis.excluded[at]),
            "final": bool(diagnosis.left_out[at]),
            "w": float(w[at]),
        }
        for at in rows[np.argsort(lines[rows])]
    ]


def _identity(candidate: Candidate) -> dict[str, Any]:
    return {
        **picked(candidate, "kind", "joint", "order"),
        "cycles": dict(candidate.keys).get("cycles"),
        **picked(candidate, "component", "covariate"),
        **({} if candidate.artefact is None else {"artefact": candidate.artefact}),
        **({} if candidate.at_s is None else {"at_s": candidate.at_s}),
    }


def _term(term: Term, *, written: bool) -> dict[str, Any]:
    values = {
        "status": term.status,
        **_identity(term.candidate),
        **({} if term.harmonic is None else {"harmonic": term.harmonic}),
        "parameters": dict(term.estimates),
        "log_bayes_factor": term.log_bayes_factor,
        "p_value": 0.0 if term.log10_p < _LEAST_LOG10_P else 10.0**term.log10_p,
        "log10_p": term.log10_p,
        "alternatives": [
            {
                **_identity(alternative.candidate),
                **picked(alternative, "log_bayes_factor", "correlation", "alias"),
            }
            for alternative in term.alternatives
        ],
        "separate_by": term.separate_by,
        "accepted": term.accepted,
        "in_arm_file": written,
        "oversized": term.is_oversized,
        "negative": term.is_negative,
        "helps": not term.is_unhelpful,
    }
    if term.seen is not None:
        values["seen"] = dict(zip(("low", "high"), term.seen, strict=True))
    if term.cluster is not None:
        values["poses"] = picked(
            term.cluster, "low", "high", excluded="n_excluded", all="n_poses"
        )
    if term.misfit is not None:
        values["held_out"] = {
            **picked(term.misfit.figures, "chi2", "rms_mm", all="n_poses"),
            **picked(
                term.misfit,
                contradicting="n_contradicting",
                contradicting_there="n_contradicting_there",
                all_there="n_poses_there",
            ),
        }
    return values


def _ledger_line(step: Step) -> dict[str, Any]:
    def held_out(figures: HoldoutResult) -> dict[str, Any]:
        return picked(figures, held_out_rms_mm="rms_mm", held_out_chi2="chi2")

    entry = {**picked(step, "effect", "sigma0"), **held_out(step.held_out)}
    rest = step.held_out.without_blunders
    if rest is not None:
        entry["without_blunders"] = held_out(rest)
    return entry


def _gap(diagnosis: Diagnosis) -> dict[str, Any]:
    gap, ledger = diagnosis.gap, diagnosis.ledger
    figures = _figures(gap.before, gap.after)
    first, last = gap.before.without_blunders, gap.after.without_blunders
    if first is not None and last is not None:
        lines = diagnosis.campaign.poses.lines[diagnosis.blunders]
        figures["without_blunders"] = {
            **_figures(first, last),
            "left_out": [{"line": line} for line in sorted(lines.tolist())],
        }
    if not diagnosis.writes_all_terms:
        figures["with_all_terms"] = _figures(ledger[0].held_out, ledger[-1].held_out)
    return figures


def _figures(first: HoldoutResult, last: HoldoutResult) -> dict[str, Any]:
    def pair(before: float | None, after: float | None) -> dict[str, float | None]:
        return {"before": before, "after": after}

    entry: dict[str, Any] = {
        "held_out_rms_mm": pair(first.rms_mm, last.rms_mm),
        "held_out_chi2": pair(first.chi2, last.chi2),
        "held_out_largest_mm": pair(first.largest_mm, last.largest_mm),
        "closed": closed(first.chi2, last.chi2, last.n),
        "n": last.n,
        "n_poses": last.n_poses,
    }
    means_mm = first.mean_distance_mm, last.mean_distance_mm
    if None not in means_mm:
        entry["held_out_mean_distance_mm"] = pair(*means_mm)
    return entry


def _size(value: float | None, unit: str) -> dict[str, Any] | None:
    return None if value is None else {"value": value, "unit": unit}


def covariance_of(final: IteratedAdjustment) -> CartesianCovariance:
    """Compute the covariance of what is estimated, as `traverse identify` does."""
    adjustment = final.adjustment
    test = global_test(
        adjustment.sigma0,
        adjustment.redundancy,
        noise_estimated=final.noise_estimated,
    )
    factor = variance_factor(adjustment.sigma0, test)
    covariance = adjustment.covariance(factor, final.design)
    return adjustment.cartesian_covariance(covariance)


def arm_with_provenance(
    diagnosis: Diagnosis, when: datetime | None = None, covariance: str | None = None
) -> Arm:
    """Make the arm that is written, with the digest of its covariance."""
    arm, campaign = diagnosis.adapted, diagnosis.campaign
    effects = arm.effects
    if campaign.start_utc is None:
        nowhere = campaign.start
        effects = tuple(
            effect
            for effect in effects
            if has_epoch(effect, campaign) or effect.epoch_utc != nowhere
        )
    provenance = Provenance(
        sigma0=diagnosis.after.sigma0,
        redundancy=diagnosis.after.redundancy,
        date=(when or datetime.now(UTC)).replace(microsecond=0),
        campaign_digest=campaign.digest or None,
        design_digest=arm_digest(diagnosis.arm),
        parameters=diagnosis.after.network.parameters.free_names,
        covariance_file=None if covariance is None else COVARIANCE_FILE,
        covariance_digest=covariance,
    )
    return arm.model_copy(update={"effects": effects, "identification": provenance})


def accept_adapted(path: Path, arm: Arm, folder: Path) -> None:
    """Replace an arm file by the adapted arm of a folder, its covariance beside it.

    Raises:
        FileError: The arm breaks a rule of arm files; an old file stays.
        OSError: A file cannot be read or written.
    """
    covariance = bytes_of(folder / COVARIANCE_FILE)
    with replacing(path.parent / COVARIANCE_FILE) as file:
        file.write(covariance)
    write_adapted(path, arm, path)


def write_adapted(path: Path, arm: Arm, source: Path) -> None:
    """Write an arm file whole, with the comments of its source file.

    The source may be the file itself.

    Raises:
        FileError: The arm breaks a rule of arm files; an old file stays.
        OSError: A file cannot be read or written.
    """
    values = arm.model_dump(by_alias=True, exclude_unset=True)
    text = arm_text(values, text_of(source))
    if parse_arm(text, str(path)) != arm:
        raise FileError(path, "would not hold all values of this arm")
    write_atomically(path, text)

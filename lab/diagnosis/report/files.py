"""What a diagnosis writes: arm, diagnosis.json, discrepancies.csv, page, pictures."""

import json
import math
import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.outlier_clusters import Cluster
from traverse.lab.diagnosis.model.result import (
    Detectable,
    Diagnosis,
    Estimate,
    Step,
    Term,
)
from traverse.lab.diagnosis.report import plots_of, report_page
from traverse.lab.diagnosis.report.adapted_arm import (
    arm_with_provenance,
    terms_without_epoch,
    write_adapted,
)
from traverse.lab.diagnosis.report.discrepancies import write_discrepancies
from traverse.strict_toml.writing import write_atomically

SCHEMA = "traverse/diagnosis/1"

# Smaller p-values are no numbers any more.
_LEAST_LOG10_P = -300.0
_TERM_PICTURE = re.compile(r"term-\d+\.png")


def write_diagnosis(
    folder: str | Path,
    diagnosis: Diagnosis,
    source: str | Path,
    when: datetime | None = None,
) -> Arm:
    """Write everything into a folder, which is made if need be.

    Args:
        folder: Where to.
        diagnosis: The result.
        source: The arm file that was diagnosed: its comments are kept.
        when: Date of the diagnosis; default now.

    Returns:
        The adapted arm as written, with its provenance.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    arm = arm_with_provenance(diagnosis, when)
    write_adapted(target / "arm.toml", arm, Path(source))
    text = json.dumps(diagnosis_json(diagnosis), indent=1, allow_nan=False)
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
    write_atomically(target / "report.html", report_page(diagnosis, plots))
    return arm


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Put a diagnosis into the plain values of `diagnosis.json`."""
    lines = sorted(diagnosis.campaign.poses.lines[diagnosis.excluded].tolist())
    noise = diagnosis.noise
    unwritten = terms_without_epoch(diagnosis)
    return {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "terms": [
            _term(term, written=term.accepted and term not in unwritten)
            for term in diagnosis.terms
        ],
        "sigma0": {
            "before": _number(diagnosis.before.sigma0),
            "after": _number(diagnosis.after.sigma0),
        },
        "gap": _gap(diagnosis),
        "excluded": [{"line": line} for line in lines],
        "detectable": detectable_json(diagnosis.detectable),
        "ledger": [_step(step) for step in diagnosis.ledger],
        "vetoed": diagnosis.vetoed,
        "leftovers": [
            {
                "bank": left.bank.name.lower(),
                **_identity(left.candidate),
                "log10_p": _number(left.log10_p),
                "threshold_log10_p": _number(left.threshold_log10_p),
            }
            for left in diagnosis.leftovers
        ],
        "noise": {
            "encoder_rad": list(noise.encoder_rad),
            "contact_mm": {
                artefact.id: std
                for artefact, std in zip(
                    diagnosis.campaign.artefacts, noise.contact_mm, strict=True
                )
            },
            "serial_share": noise.serial_share,
            "serial_phi": noise.serial_phi,
        },
        "seed": diagnosis.seed,
    }


def detectable_json(detectable: Sequence[Detectable]) -> list[dict[str, Any]]:
    """Put minimal detectable sizes into plain values."""
    return [
        {
            **_identity(entry.candidate),
            "key": entry.key,
            "minimum": _size(entry.minimum, entry.unit),
            "best": _size(entry.best, entry.unit),
            "probe_mm": _number(entry.probe_mm),
            "why": entry.why or None,
        }
        for entry in detectable
    ]


def pose_parts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Say what became of each pose: choosing, held_out or excluded."""
    found = np.where(diagnosis.held_out, "held_out", "choosing")
    found = np.where(diagnosis.excluded, "excluded", found)
    return tuple(found.tolist())


def _identity(candidate: Candidate) -> dict[str, Any]:
    return {
        "kind": candidate.kind,
        "joint": candidate.joint,
        "order": candidate.order,
        "cycles": dict(candidate.keys).get("cycles"),
        "component": candidate.component,
        "covariate": candidate.covariate,
        **({} if candidate.artefact is None else {"artefact": candidate.artefact}),
        **({} if candidate.at_s is None else {"at_s": candidate.at_s}),
    }


def _term(term: Term, *, written: bool) -> dict[str, Any]:
    return {
        "status": term.status,
        **_identity(term.candidate),
        **({} if term.harmonic is None else {"harmonic": term.harmonic}),
        "parameters": {key: _estimate(e) for key, e in term.estimates.items()},
        "log_bayes_factor": _number(term.log_bayes_factor),
        "p_value": 0.0 if term.log10_p < _LEAST_LOG10_P else 10.0**term.log10_p,
        "log10_p": _number(term.log10_p),
        "alternatives": [
            {
                **_identity(one.candidate),
                "log_bayes_factor": _number(one.log_bayes_factor),
                "correlation": _number(one.correlation),
                "alias": one.alias,
            }
            for one in term.alternatives
        ],
        "separate_by": term.separate_by,
        "accepted": term.accepted,
        "in_arm_file": written,
        **({} if term.cluster is None else {"poses": _cluster(term.cluster)}),
    }


def _cluster(place: Cluster) -> dict[str, Any]:
    return {
        "low": _number(place.low),
        "high": _number(place.high),
        "excluded": place.n_excluded,
        "all": place.n_poses,
    }


def _estimate(estimate: Estimate) -> dict[str, Any]:
    def plain(value: float | tuple[float, ...]) -> float | list[float | None] | None:
        if isinstance(value, tuple):
            return [_number(one) for one in value]
        return _number(value)

    return {
        "value": plain(estimate.value),
        "std": plain(estimate.std),
        "unit": estimate.unit,
    }


def _gap(diagnosis: Diagnosis) -> dict[str, Any]:
    first, last = diagnosis.ledger[0].held_out, diagnosis.ledger[-1].held_out
    found: dict[str, Any] = {
        "held_out_rms_mm": {
            "before": _number(first.rms_mm),
            "after": _number(last.rms_mm),
        },
        "held_out_chi2": {"before": _number(first.chi2), "after": _number(last.chi2)},
        "closed": None if diagnosis.closed is None else _number(diagnosis.closed),
        "n": last.n,
    }
    if first.mean_distance_mm is not None and last.mean_distance_mm is not None:
        found["held_out_mean_distance_mm"] = {
            "before": _number(first.mean_distance_mm),
            "after": _number(last.mean_distance_mm),
        }
    return found


def _step(step: Step) -> dict[str, Any]:
    return {
        "effect": step.effect,
        "held_out_rms_mm": _number(step.held_out.rms_mm),
        "held_out_chi2": _number(step.held_out.chi2),
        "sigma0": _number(step.sigma0),
    }


def _size(value: float | None, unit: str) -> dict[str, Any] | None:
    return None if value is None else {"value": _number(value), "unit": unit}


def _number(value: float) -> float | None:
    """JSON has no infinity and no NaN."""
    return float(value) if math.isfinite(value) else None

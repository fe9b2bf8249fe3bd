"""A diagnosis as its outcome: figures as `diagnosis.json` has them, and their state."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from traverse.lab.adjustment import Adjustment
from traverse.lab.campaign.prior import family_json
from traverse.lab.diagnosis.model.fit import terms_without_epoch
from traverse.lab.diagnosis.model.result import (
    Detectable,
    Diagnosis,
    HoldoutResult,
    Step,
    Term,
    closed,
)
from traverse.lab.outcomes.base import Outcome
from traverse.lab.outcomes.diagnosis import (
    BeforeAfter,
    DetectableSize,
    DiagnosisEvidence,
    DiagnosisFigures,
    FoundTerm,
    Gap,
    LedgerLine,
    LeftOutPose,
    judge_diagnosis,
)
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.quantities import picked, plain_values

SCHEMA = "traverse/diagnosis/1"

# Smaller p-values are no numbers any more.
_LEAST_LOG10_P = -300.0


def outcome_of(diagnosis: Diagnosis) -> Outcome:
    return _judged(diagnosis, figures_of(diagnosis))


def diagnosis_json(
    diagnosis: Diagnosis, provenance: ReportProvenance | None = None
) -> dict[str, Any]:
    figures = figures_of(diagnosis)
    return {
        "schema": SCHEMA,
        "provenance": (provenance or diagnosis.campaign.provenance()).values,
        **plain_values(_judged(diagnosis, figures)),
        **plain_values(figures),
    }


def _judged(diagnosis: Diagnosis, figures: DiagnosisFigures) -> Outcome:
    network, prior = diagnosis.after.network, diagnosis.campaign.prior
    return judge_diagnosis(
        DiagnosisEvidence(
            figures=figures,
            n_poses=len(diagnosis.campaign.poses),
            time_is_order=diagnosis.campaign.time_is_order,
            has_length=network.has_length(),
            holds_scale=network.holds_scale,
            was_identified=diagnosis.arm.identification is not None,
            undetermined_mm=_undetermined_mm(diagnosis.final.adjustment),
            contradicted=() if prior is None else prior.contradicted,
        )
    )


def _undetermined_mm(adjustment: Adjustment) -> float:
    """Return how far the probe moves by undetermined directions but the scale."""
    network, split = adjustment.network, adjustment.split
    arm = adjustment.state.arm
    scale = network.undetermined_scale(arm)
    rest = split.undetermined - split.undetermined @ scale.T @ scale
    if not len(rest):
        return 0.0
    effects_mm = network.probe_effects_mm(arm, rest * split.tolerances)
    return float(np.linalg.norm(effects_mm))


def figures_of(diagnosis: Diagnosis) -> DiagnosisFigures:
    campaign, noise = diagnosis.campaign, diagnosis.noise
    ids = [artefact.id for artefact in campaign.artefacts]
    unwritten = terms_without_epoch(diagnosis)
    turned = campaign.poses.lines[diagnosis.turned].tolist()
    tools_mm = diagnosis.after.state.arm.tools_mm
    tools = {
        tool.name: {"vector_mm": vector_mm}
        for tool, vector_mm in zip(campaign.tools, tools_mm, strict=True)
    }
    return DiagnosisFigures(
        verdict=diagnosis.verdict,
        visible={"n": diagnosis.n_visible, "of": diagnosis.n_library},
        terms=tuple(
            _term(term, written=term.accepted and term not in unwritten)
            for term in diagnosis.terms
        ),
        sigma0=BeforeAfter(diagnosis.before.sigma0, diagnosis.after.sigma0),
        gap=_gap(diagnosis),
        excluded=_excluded(diagnosis),
        orientations={"excluded": [{"line": line} for line in turned]},
        detectable=detectable_sizes(diagnosis.detectable),
        ledger=tuple(_ledger_line(step) for step in diagnosis.ledger),
        vetoed=diagnosis.vetoed,
        times_stated_noise=diagnosis.exceeded,
        identified_anew=diagnosis.is_identified_anew,
        leftovers=diagnosis.leftovers,
        noise=asdict(noise)
        | {"contact_mm": dict(zip(ids, noise.contact_mm, strict=True))},
        seed=diagnosis.seed,
        holdout_by=diagnosis.holdout_by,
        mass_distribution=diagnosis.all_terms.mass_distribution() or None,
        tools=tools or None,
        **family_json(campaign.prior),
    )


def detectable_sizes(detectable: Sequence[Detectable]) -> tuple[DetectableSize, ...]:
    return tuple(
        DetectableSize(
            candidate=entry.candidate,
            key=entry.key,
            minimum=_size(entry.minimum, entry.unit),
            best=_size(entry.best, entry.unit),
            probe_mm=entry.probe_mm,
            why=entry.why or None,
        )
        for entry in detectable
    )


def _size(value: float | None, unit: str) -> dict[str, Any] | None:
    return None if value is None else {"value": value, "unit": unit}


def _excluded(diagnosis: Diagnosis) -> tuple[LeftOutPose, ...]:
    """List the poses that took no part, in choosing or in the last estimates."""
    lines, w = diagnosis.campaign.poses.lines, diagnosis.final.statistics.w
    rows = np.flatnonzero(diagnosis.excluded | diagnosis.left_out)
    return tuple(
        LeftOutPose(
            line=int(lines[at]),
            choosing=bool(diagnosis.excluded[at]),
            final=bool(diagnosis.left_out[at]),
            w=float(w[at]),
        )
        for at in rows[np.argsort(lines[rows])]
    )


def _term(term: Term, *, written: bool) -> FoundTerm:
    seen = None if term.seen is None else {"low": term.seen[0], "high": term.seen[1]}
    poses = held_out = None
    if term.cluster is not None:
        poses = picked(
            term.cluster, "low", "high", excluded="n_excluded", all="n_poses"
        )
    if term.misfit is not None:
        held_out = {
            **picked(term.misfit.figures, "chi2", "rms_mm", all="n_poses"),
            **picked(
                term.misfit,
                contradicting="n_contradicting",
                contradicting_there="n_contradicting_there",
                all_there="n_poses_there",
            ),
        }
    return FoundTerm(
        candidate=term.candidate,
        status=term.status,
        harmonic=term.harmonic,
        parameters=term.estimates,
        log_bayes_factor=term.log_bayes_factor,
        p_value=0.0 if term.log10_p < _LEAST_LOG10_P else 10.0**term.log10_p,
        log10_p=term.log10_p,
        alternatives=term.alternatives,
        separate_by=term.separate_by,
        accepted=term.accepted,
        in_arm_file=written,
        oversized=term.is_oversized,
        negative=term.is_negative,
        helps=not term.is_unhelpful,
        seen=seen,
        poses=poses,
        held_out=held_out,
    )


def _ledger_line(step: Step) -> LedgerLine:
    rest = step.held_out.without_blunders
    return LedgerLine(
        effect=step.effect,
        sigma0=step.sigma0,
        without_blunders=None if rest is None else _held_out(rest),
        **_held_out(step.held_out),
    )


def _held_out(figures: HoldoutResult) -> dict[str, float]:
    return {"held_out_rms_mm": figures.rms_mm, "held_out_chi2": figures.chi2}


def _gap(diagnosis: Diagnosis) -> Gap:
    gap, ledger = diagnosis.gap, diagnosis.ledger
    without = with_all = None
    first, last = gap.before.without_blunders, gap.after.without_blunders
    if first is not None and last is not None:
        lines = diagnosis.campaign.poses.lines[diagnosis.blunders]
        left_out = [{"line": line} for line in sorted(lines.tolist())]
        without = _figures(first, last, left_out=left_out)
    if not diagnosis.writes_all_terms:
        with_all = _figures(ledger[0].held_out, ledger[-1].held_out)
    return _figures(
        gap.before, gap.after, without_blunders=without, with_all_terms=with_all
    )


def _figures(first: HoldoutResult, last: HoldoutResult, **beside: Any) -> Gap:
    means_mm = BeforeAfter(first.mean_distance_mm, last.mean_distance_mm)
    has_means = None not in (means_mm.before, means_mm.after)
    return Gap(
        held_out_rms_mm=BeforeAfter(first.rms_mm, last.rms_mm),
        held_out_chi2=BeforeAfter(first.chi2, last.chi2),
        held_out_largest_mm=BeforeAfter(first.largest_mm, last.largest_mm),
        closed=closed(first.chi2, last.chi2, last.n),
        n=last.n,
        n_poses=last.n_poses,
        held_out_mean_distance_mm=means_mm if has_means else None,
        **beside,
    )

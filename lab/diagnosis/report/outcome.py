"""A diagnosis as its outcome: figures as `diagnosis.json` has them, and their state."""

from dataclasses import asdict
from typing import Any

import numpy as np

from traverse.lab.campaign.prior import family_json
from traverse.lab.diagnosis.model.result import Diagnosis, closed
from traverse.lab.diagnosis.report.conditions import CONDITIONS
from traverse.lab.outcomes.base import Outcome, judge
from traverse.lab.outcomes.diagnosis import (
    BeforeAfter,
    DiagnosisFigures,
    Gap,
    HoldoutResult,
    LeftOutPose,
)
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.quantities import plain_values

SCHEMA = "traverse/diagnosis/1"


def outcome_of(diagnosis: Diagnosis) -> Outcome:
    return judge(CONDITIONS, diagnosis)


def diagnosis_json(
    diagnosis: Diagnosis, provenance: ReportProvenance | None = None
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "provenance": (provenance or diagnosis.campaign.provenance()).values,
        **plain_values(outcome_of(diagnosis)),
        **plain_values(figures_of(diagnosis)),
    }


def figures_of(diagnosis: Diagnosis) -> DiagnosisFigures:
    campaign, noise = diagnosis.campaign, diagnosis.noise
    ids = [artefact.id for artefact in campaign.artefacts]
    turned = campaign.poses.lines[diagnosis.turned].tolist()
    tools_mm = diagnosis.after.state.arm.tools_mm
    tools = {
        tool.name: {"vector_mm": vector_mm}
        for tool, vector_mm in zip(campaign.tools, tools_mm, strict=True)
    }
    return DiagnosisFigures(
        verdict=diagnosis.verdict,
        visible={"n": diagnosis.n_visible, "of": diagnosis.n_library},
        terms=diagnosis.terms,
        sigma0=BeforeAfter(diagnosis.before.sigma0, diagnosis.after.sigma0),
        gap=_gap(diagnosis),
        excluded=_excluded(diagnosis),
        orientations={"excluded": [{"line": line} for line in turned]},
        detectable=diagnosis.detectable,
        ledger=diagnosis.ledger,
        vetoed=diagnosis.vetoed,
        times_stated_noise=diagnosis.exceeded,
        identified_anew=diagnosis.is_identified_anew,
        wrong_signs=diagnosis.wrong_signs,
        zero_offsets_rad=diagnosis.zero_offsets_rad,
        leftovers=diagnosis.leftovers,
        noise=asdict(noise)
        | {"contact_mm": dict(zip(ids, noise.contact_mm, strict=True))},
        seed=diagnosis.seed,
        holdout_by=diagnosis.holdout_by,
        mass_distribution=diagnosis.all_terms.mass_distribution() or None,
        tools=tools or None,
        **family_json(campaign.prior),
    )


def _excluded(diagnosis: Diagnosis) -> tuple[LeftOutPose, ...]:
    """List the poses that took no part, in choosing or in the last estimates."""
    lines, w = diagnosis.campaign.poses.lines, diagnosis.final.statistics.w
    rows = np.flatnonzero(diagnosis.excluded | diagnosis.left_out)
    return tuple(
        LeftOutPose(
            line=int(lines[row]),
            choosing=bool(diagnosis.excluded[row]),
            final=bool(diagnosis.left_out[row]),
            w=float(w[row]),
        )
        for row in rows[np.argsort(lines[rows])]
    )


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
        held_out_chi2_std=last.chi2_std,
        held_out_largest_mm=BeforeAfter(first.largest_mm, last.largest_mm),
        closed=closed(first.chi2, last.chi2, last.n),
        n=last.n,
        n_poses=last.n_poses,
        held_out_mean_distance_mm=means_mm if has_means else None,
        **beside,
    )

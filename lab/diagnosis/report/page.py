"""The report of a diagnosis: one page without references, lines for terminals."""

from collections.abc import Mapping

import numpy as np

from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.names import (
    candidate_label,
    cluster_text,
    depends_on_time,
    joint_rows,
    moves_base,
    seen_text,
    step_names,
    term_size_text,
)
from traverse.lab.diagnosis.report.outcome import outcome_of
from traverse.lab.diagnosis.report.pictures import Plots
from traverse.lab.outcomes.diagnosis import Estimate
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.templates import Filters, Words, page


def _n_judged(diagnosis: Diagnosis) -> int:
    return int(np.count_nonzero(diagnosis.choosing & ~diagnosis.excluded))


def _estimate_rows(estimates: Mapping[str, Estimate]) -> list[list[str]]:
    """List the keys of an effect, the components of a vector one by one."""
    rows = []
    for key, estimate in estimates.items():
        if isinstance(estimate.value, tuple) and isinstance(estimate.std, tuple):
            parts = zip(estimate.value, estimate.std, strict=True)
            rows += [
                [f"{key} [{index}]", f"{value:.4g}", f"{std:.2g}", estimate.unit]
                for index, (value, std) in enumerate(parts)
            ]
        else:
            rows.append(
                [key, f"{estimate.value:.5g}", f"{estimate.std:.2g}", estimate.unit]
            )
    return rows


_FILTERS: Filters = {
    "label": candidate_label,
    "size_text": term_size_text,
    "cluster_text": cluster_text,
    "seen_text": seen_text,
    "moves_base": moves_base,
    "depends_on_time": depends_on_time,
    "mass_distribution": lambda adjustment: adjustment.mass_distribution(),
    "n_judged": _n_judged,
    "outcome": outcome_of,
    "estimate_rows": _estimate_rows,
}
WORDS = Words("diagnosis/report/words.jinja", **_FILTERS)


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    return WORDS.lines("summary", diagnosis)


def report_page(
    diagnosis: Diagnosis, plots: Plots, provenance: ReportProvenance | None = None
) -> str:
    joint_names = list(diagnosis.campaign.joint_names)
    return page(
        "diagnosis/report/page.jinja",
        _FILTERS,
        diagnosis=diagnosis,
        plots=plots,
        provenance=provenance or diagnosis.campaign.provenance(),
        words=WORDS,
        step_names=step_names(diagnosis),
        joint_names=joint_names,
        joint_rows=joint_rows(diagnosis.detectable, joint_names),
        excluded=np.flatnonzero(
            diagnosis.excluded | diagnosis.left_out | diagnosis.blunders
        ).tolist(),
    )

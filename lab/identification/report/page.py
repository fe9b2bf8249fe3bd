"""The report of an identification: one page without references, lines for terminals."""

from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.lab.identification.report.pictures import pictures_of
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.results.undetermined import combination
from traverse.lab.identification.uncertainty_map import (
    UncertaintyMap,
    arm_uncertainty,
    uncertainty_map,
)
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.templates import Filters, Words, page

_FILTERS: Filters = {
    "combination": combination,
    "mass_distribution": lambda adjustment: adjustment.mass_distribution(),
    "median": lambda values: float(np.median(list(values))),
    "rms_all_mm": lambda result: float(
        np.sqrt(np.nanmean(result.statistics.misclosures_mm**2))
    ),
    "degrees": lambda angles_rad: np.degrees(angles_rad).tolist(),
}
WORDS = Words("identification/report/words.jinja", **_FILTERS)


def result_map(result: Identification) -> UncertaintyMap:
    arm = arm_uncertainty(result.adjustment, result.covariance)
    return uncertainty_map(arm, result.campaign.poses.angles_rad[result.included])


def summary_lines(result: Identification, uncertainty: UncertaintyMap) -> list[str]:
    return WORDS.lines("summary", result, uncertainty, outcome_of(result))


def report_page(
    result: Identification,
    uncertainty: UncertaintyMap,
    provenance: ReportProvenance | None = None,
) -> str:
    """Make the page; the text is complete in itself. Provenance: this user, now."""
    effects_mm = np.empty(0)
    if result.parameters:  # of each parameter's standard deviation alone at the probe
        stds = np.diag([entry.std for entry in result.parameters])
        network, state = result.adjustment.network, result.adjustment.state
        effects_mm = network.probe_effects_mm(state.arm, stds)
    return page(
        "identification/report/page.jinja",
        _FILTERS,
        result=result,
        uncertainty=uncertainty,
        judged=outcome_of(result),
        words=WORDS,
        pictures=pictures_of(result, uncertainty),
        provenance=provenance or result.campaign.provenance(),
        controllability=_known(result, result.statistics.controllability),
        detectable_mm=_known(result, result.statistics.detectable_mm),
        effects_mm=effects_mm,
        held=_held(result),
        excluded=_excluded(result),
        joint_columns=[f"{name} [degrees]" for name in result.campaign.joint_names],
    )


def _known(result: Identification, values: Floats) -> list[float]:
    of_included = values[result.included]
    known: list[float] = of_included[np.isfinite(of_included)].tolist()
    return known


def _held(result: Identification) -> list[str]:
    """Name the axes and links that were not free."""
    parameters = result.adjustment.network.parameters
    free = set(parameters.free_names)
    return [
        name
        for name in parameters.of_geometry().names
        if name not in free and any(part in name for part in (".axis.", ".link."))
    ]


def _excluded(result: Identification) -> list[dict[str, Any]]:
    """List the poses that contradict the others, the worst first."""
    poses, campaign = result.campaign.poses, result.campaign
    w = result.statistics.w
    parts = {entry.line: entry.part for entry in result.excluded}
    rows = []
    for row in sorted(np.flatnonzero(~result.included), key=lambda row: -w[row]):
        artefact = int(poses.artefacts[row])
        misclosures_mm = result.statistics.misclosures_mm[row]
        rows.append(
            {
                "artefact": campaign.artefacts[artefact].id,
                "feature": campaign.feature_names[artefact][int(poses.features[row])],
                "part": parts[int(poses.lines[row])],
                "line": int(poses.lines[row]),
                "w": float(w[row]),
                "size_mm": float(np.sqrt(np.nansum(misclosures_mm**2))),
            }
        )
    return rows

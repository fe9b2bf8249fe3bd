"""An identification, and the files of its result."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import SPLITS
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.prediction import holdout_figures
from traverse.lab.identification.report.page import (
    report_page,
    result_map,
    summary_lines,
)
from traverse.lab.identification.results.evidence import outcome_of
from traverse.lab.identification.results.files import (
    IDENTIFICATION,
    IDENTIFICATION_FILES,
    identification_json,
    write_result,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.outcomes.progress import Progress
from traverse.lab.report.checksums import SUMS, sums_of, write_sums
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.runs.inputs import BreakdownError, broken_down, date_of
from traverse.strict_toml.writing import write_atomically

NO_ARM = (
    "an arm file of this result might be measured with (--write-unfit-arm writes it)"
)


@dataclass(frozen=True, slots=True)
class KeptAside:
    """Poses that take no part: which part of all, by time or artefact, from a seed."""

    part: float
    by: str
    seed: int


def identified(
    campaign: Campaign,
    arm: Arm,
    options: Options,
    kept_aside: KeptAside | None = None,
    progress: Callable[[Campaign], Progress] | None = None,
) -> Identification:
    """Identify, and predict what is kept aside.

    Progress is made for the poses that take part.

    Raises:
        IdentificationError: Arm, campaign and wishes do not fit together.
        BreakdownError: The adjustment broke down.
    """
    chosen, others = campaign, None
    if kept_aside is not None:
        inside, outside = SPLITS[kept_aside.by](
            campaign, kept_aside.seed, kept_aside.part
        )
        if not outside.any():
            raise IdentificationError(
                f"nothing can be kept aside of {len(campaign.poses)} poses at "
                f"{len(campaign.artefacts)} artefacts by {kept_aside.by}: the rest "
                "would not determine the arm or an artefact; measure more, or leave "
                "--holdout out"
            )
        chosen, others = campaign.part(inside), campaign.part(outside)
    told = None if progress is None else progress(chosen)
    try:
        result = identify(chosen, arm, options, told)
        if kept_aside is None or others is None or not result.converged:
            return result
        figures = holdout_figures(result, others, kept_aside.by, kept_aside.seed)
    except np.linalg.LinAlgError as error:
        raise BreakdownError(broken_down(campaign, error)) from error
    return replace(result, holdout=figures)


def write_identified(
    result: Identification,
    out: Path,
    provenance: ReportProvenance,
    *,
    unfit_arm: bool = False,
) -> list[str]:
    """Write the files of `traverse identify`; the summary, and what was written.

    An arm file that must not be measured with only where an unfit arm is wanted.
    """
    found = result_map(result)
    lines = summary_lines(result, found)
    page = report_page(result, found, provenance)
    if not (outcome_of(result).writes_arm or (unfit_arm and result.converged)):
        # An arm file of it might be measured with.
        out.mkdir(parents=True, exist_ok=True)
        for name in IDENTIFICATION_FILES:
            (out / name).unlink(missing_ok=True)
        text = json.dumps(identification_json(result, provenance), indent=1)
        write_atomically(out / IDENTIFICATION, text + "\n")
        write_atomically(out / "report.html", page)
        return [
            *lines,
            f"wrote {out}: {IDENTIFICATION}, report.html; no arm.toml: {NO_ARM}",
        ]
    write_result(result, out, date_of(provenance), provenance)
    write_atomically(out / "report.html", page)
    write_sums(out, sums_of(out, IDENTIFICATION_FILES))
    return [*lines, f"wrote {out}: {', '.join(IDENTIFICATION_FILES)}, {SUMS}"]

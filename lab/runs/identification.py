"""An identification, and the files of its result."""

import json
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import (
    report_page,
    result_map,
    summary_lines,
)
from traverse.lab.identification.results.files import (
    IDENTIFICATION,
    IDENTIFICATION_FILES,
    identification_json,
    write_result,
)
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.identification.results.result import Identification
from traverse.lab.outcomes.adjustment import Progress
from traverse.lab.outcomes.common_conditions import NO_ARM
from traverse.lab.report.provenance import SUMS, ReportProvenance, sums_of, write_sums
from traverse.lab.runs.inputs import BreakdownError, broken_down, date_of
from traverse.strict_toml.writing import write_atomically


def identified(
    campaign: Campaign, arm: Arm, options: Options, progress: Progress | None = None
) -> Identification:
    """Identify.

    Raises:
        IdentificationError: Arm, campaign and options are inconsistent.
        BreakdownError: The adjustment broke down.
    """
    try:
        return identify(campaign, arm, options, progress)
    except np.linalg.LinAlgError as error:
        raise BreakdownError(broken_down(campaign, error)) from error


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
    uncertainty = result_map(result)
    lines = summary_lines(result, uncertainty)
    page = report_page(result, uncertainty, provenance)
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
            f"wrote {out}: {IDENTIFICATION}, report.html; no arm.toml: {NO_ARM} "
            "(--write-unfit-arm writes it)",
        ]
    write_result(result, out, date_of(provenance), provenance)
    write_atomically(out / "report.html", page)
    write_sums(out, sums_of(out, IDENTIFICATION_FILES))
    return [*lines, f"wrote {out}: {', '.join(IDENTIFICATION_FILES)}, {SUMS}"]

"""A campaign from its folder to the files of its result: for commands and fleets."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.campaign.prior import read_prior
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.holdout.holdout import SPLITS
from traverse.lab.diagnosis.model.result import Diagnosis, DiagnosisOptions
from traverse.lab.diagnosis.report.files import write_adapted, write_diagnosis
from traverse.lab.diagnosis.report.page import summary_lines as diagnosis_lines
from traverse.lab.diagnosis.scans.scan_diagnosis import (
    StreamDiagnosis,
    diagnose_stream,
    stream_json,
    stream_lines,
)
from traverse.lab.diagnosis.search.forward_search import Progress as Stages
from traverse.lab.identification.identify import IdentificationError, Options, identify
from traverse.lab.identification.prediction import holdout_figures
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
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.solve.adjustment import Progress
from traverse.lab.report.checksums import SUMS, sums_of, write_sums
from traverse.lab.report.provenance import ReportProvenance
from traverse.strict_toml.writing import write_atomically


class BreakdownError(ArithmeticError):
    """The mathematics of an adjustment broke down."""


@dataclass(frozen=True, slots=True)
class KeptAside:
    """Poses that take no part: which part of all, by time or artefact, from a seed."""

    part: float
    by: str
    seed: int


def read_inputs(
    folder: Path, arm_file: Path, family: Path | None = None, prior: Sequence[str] = ()
) -> tuple[Arm, Campaign]:
    """Read an arm and a campaign, with what its family says of parameters by pattern.

    Raises:
        FileError: A file is wrong, or the family is of another design.
    """
    arm = read_arm(arm_file)
    names = [joint.name for joint in arm.joints]
    campaign = read_campaign(folder, names, several_tools=True, orientations=True)
    if family is not None:
        campaign = replace(campaign, prior=read_prior(family, arm, prior))
    return arm, campaign


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
        raise BreakdownError(_broken(campaign, error)) from error
    return replace(result, holdout=figures)


def _broken(campaign: Campaign, error: np.linalg.LinAlgError) -> str:
    return (
        f"{campaign.name}: the adjustment broke down ({error}); check units, signs and "
        "zeros of the arm file, and the features of the poses"
    )


def write_identified(
    result: Identification, out: Path, provenance: ReportProvenance
) -> list[str]:
    """Write the files of `traverse identify`; the summary, and what was written."""
    found = result_map(result)
    lines = summary_lines(result, found)
    page = report_page(result, found, provenance)
    if not result.converged:
        # An arm file of it might be measured with.
        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(identification_json(result, provenance), indent=1)
        write_atomically(out / IDENTIFICATION, text + "\n")
        write_atomically(out / "report.html", page)
        return [*lines, f"wrote {out}: {IDENTIFICATION}, report.html; no arm.toml"]
    write_result(result, out, _date(provenance), provenance)
    write_atomically(out / "report.html", page)
    write_sums(out, sums_of(out, IDENTIFICATION_FILES))
    return [*lines, f"wrote {out}: {', '.join(IDENTIFICATION_FILES)}, {SUMS}"]


def _date(provenance: ReportProvenance) -> datetime:
    return datetime.fromisoformat(provenance.date_utc)


def diagnosed(
    campaign: Campaign,
    arm: Arm,
    options: DiagnosisOptions,
    progress: Stages | None = None,
) -> tuple[Diagnosis, StreamDiagnosis | None]:
    """Diagnose single poses, or a dense scan.

    Raises:
        IdentificationError: Arm and campaign do not fit together.
        BreakdownError: The adjustment broke down.
    """
    try:
        if campaign.is_stream:
            stream = diagnose_stream(campaign, arm, options, progress)
            return stream.diagnosis, stream
        return diagnose(campaign, arm, options, progress), None
    except np.linalg.LinAlgError as error:
        told = f"{_broken(campaign, error)}; see `traverse identify`"
        raise BreakdownError(told) from error


def write_diagnosed(
    found: tuple[Diagnosis, StreamDiagnosis | None],
    arm_file: Path,
    out: Path,
    provenance: ReportProvenance,
    *,
    accept: bool = False,
) -> list[str]:
    """Write the files of `traverse diagnose`; the summary, and what was written.

    An accepted arm replaces the arm file.
    """
    result, stream = found
    adapted = write_diagnosis(out, result, arm_file, _date(provenance), provenance)
    names = "arm.toml, diagnosis.json, discrepancies.csv, report.html, pictures"
    lines = [*diagnosis_lines(result), f"wrote {out}: {names}"]
    if accept:
        write_adapted(arm_file, adapted, arm_file)
        lines.append(f"wrote {arm_file}: the adapted arm in place of the old one")
    if stream is None:
        return lines
    text = json.dumps(stream_json(stream), indent=1, allow_nan=False)
    write_atomically(out / "stream.json", text + "\n")
    return [*stream_lines(stream), *lines, f"wrote {out / 'stream.json'}"]

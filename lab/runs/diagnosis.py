"""A diagnosis, and the files of its result."""

import json
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.result import Diagnosis, DiagnosisOptions
from traverse.lab.diagnosis.report.files import (
    accept_adapted,
    summary_lines,
    write_diagnosis,
)
from traverse.lab.diagnosis.scans.scan_diagnosis import (
    StreamDiagnosis,
    diagnose_stream,
    stream_json,
    stream_lines,
)
from traverse.lab.diagnosis.search.forward_search import Progress
from traverse.lab.outcomes.common_conditions import NO_ARM
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.runs.inputs import BreakdownError, broken_down, date_of
from traverse.strict_toml.writing import write_atomically


def diagnosed(
    campaign: Campaign,
    arm: Arm,
    options: DiagnosisOptions,
    progress: Progress | None = None,
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
        message = f"{broken_down(campaign, error)}; see `traverse identify`"
        raise BreakdownError(message) from error


def write_diagnosed(
    results: tuple[Diagnosis, StreamDiagnosis | None],
    arm_file: Path,
    out: Path,
    provenance: ReportProvenance,
    *,
    accept: bool = False,
) -> list[str]:
    """Write the files of `traverse diagnose`; the summary, and what was written.

    An accepted arm replaces the arm file, if one may be made of the result.
    """
    result, stream = results
    adapted = write_diagnosis(out, result, arm_file, date_of(provenance), provenance)
    arm_files, lack = "arm.toml, arm.cov.npz, ", ""
    if adapted is None:
        arm_files, lack = "", f"; no arm.toml: {NO_ARM}"
    files = f"{arm_files}diagnosis.json, discrepancies.csv, report.html, pictures"
    lines = [*summary_lines(result), f"wrote {out}: {files}{lack}"]
    if accept and adapted is None:
        lines.append(f"{arm_file} stays as it was: nothing was accepted")
    elif accept and adapted is not None:
        accept_adapted(arm_file, adapted, out)
        lines.append(f"wrote {arm_file}: the adapted arm in place of the old one")
    if stream is None:
        return lines
    text = json.dumps(stream_json(stream), indent=1, allow_nan=False)
    write_atomically(out / "stream.json", text + "\n")
    return [*stream_lines(stream), *lines, f"wrote {out / 'stream.json'}"]

"""Files of a diagnosis: arm, diagnosis.json, discrepancies.csv, page, pictures."""

import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from os.path import samefile
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import (
    Arm,
    arm_digest,
    geometry_digest,
    parse_arm,
)
from traverse.kinematics.arm_file.arm import Identification as Provenance
from traverse.lab.adjustment import IteratedAdjustment
from traverse.lab.diagnosis.model.fit import has_epoch
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import write_discrepancies
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
from traverse.lab.diagnosis.report.outcome import diagnosis_json, outcome_of
from traverse.lab.diagnosis.report.pictures import Plots, plots_of
from traverse.lab.outcomes.adjustment import (
    COVARIANCE_FILE,
    CartesianCovariance,
    write_covariance,
)
from traverse.lab.outcomes.common_conditions import may_be_measured_with
from traverse.lab.outcomes.diagnosis import Estimate
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.templates import Filters, Words, page
from traverse.lab.statistics.distributions import (
    arm_variance_factor,
    global_test,
    variance_factor,
)
from traverse.strict_toml.files import bytes_of, text_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.rewriting import rewritten_text
from traverse.strict_toml.writing import replacing, write_atomically


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


_TERM_PICTURE = re.compile(r"term-\d+\.png")


def write_diagnosis(
    folder: str | Path,
    diagnosis: Diagnosis,
    source: str | Path,
    when: datetime | None = None,
    provenance: ReportProvenance | None = None,
) -> Arm | None:
    """Write everything into a folder, which is made if need be.

    The comments of the source, the arm file that was diagnosed, are kept. Date and
    provenance are by default those of now. Returns the adapted arm as written, with its
    provenance; None: an arm file of the result might be measured with.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    arm: Arm | None = None
    if may_be_measured_with(outcome_of(diagnosis)):
        cartesian = covariance_of(diagnosis.final, diagnosis.other_scale)
        digest = write_covariance(cartesian, target / COVARIANCE_FILE)
        arm = arm_with_provenance(diagnosis, when, digest)
        write_adapted(target / "arm.toml", arm, Path(source))
    elif not (target / "arm.toml").exists() or not samefile(
        target / "arm.toml", source
    ):
        for name in ("arm.toml", COVARIANCE_FILE):
            (target / name).unlink(missing_ok=True)
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


def pose_parts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what became of each pose: choosing, held_out, excluded or final."""
    parts = np.where(diagnosis.choosing, "choosing", "final")
    parts = np.where(diagnosis.held_out, "held_out", parts)
    parts = np.where(diagnosis.excluded, "excluded", parts)
    return tuple(parts.tolist())


def covariance_of(
    final: IteratedAdjustment, other_scale: float = 0.0
) -> CartesianCovariance:
    """Compute the covariance of what is estimated, as `traverse identify` does.

    The arm may be larger or smaller by the part `other_scale` of itself.
    """
    adjustment = final.adjustment
    test = global_test(
        adjustment.sigma0,
        adjustment.redundancy,
        noise_estimated=final.noise_estimated,
    )
    factor = variance_factor(adjustment.sigma0, test)
    of_arm = arm_variance_factor(
        factor, test, adjustment.redundancy, adjustment.split.n_determined
    )
    covariance = adjustment.covariance(
        of_arm, adjustment.deviations_of_design(final.design, other_scale)
    )
    return adjustment.cartesian_covariance(covariance)


def arm_with_provenance(
    diagnosis: Diagnosis, when: datetime | None = None, covariance: str | None = None
) -> Arm:
    """Make the arm that is written, with the digest of its covariance."""
    arm, campaign = diagnosis.adapted, diagnosis.campaign
    if campaign.start_utc is None:
        nowhere = campaign.start
        effects = tuple(
            effect
            for effect in arm.effects
            if has_epoch(effect, campaign) or effect.epoch_utc != nowhere
        )
        arm = arm.model_copy(update={"effects": effects})
    provenance = Provenance(
        sigma0=diagnosis.after.sigma0,
        redundancy=diagnosis.after.redundancy,
        date=(when or datetime.now(UTC)).replace(microsecond=0),
        campaign_digest=campaign.digest or None,
        **campaign.temperature_range_c,
        design_digest=arm_digest(diagnosis.arm),
        parameters=diagnosis.after.network.parameters.free_names,
        covariance_file=None if covariance is None else COVARIANCE_FILE,
        covariance_digest=covariance,
        arm_digest=geometry_digest(arm),
    )
    return arm.model_copy(update={"identification": provenance})


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
    text = rewritten_text(values, text_of(source))
    if parse_arm(text, str(path)) != arm:
        raise FileError(path, "would not hold all values of this arm")
    write_atomically(path, text)

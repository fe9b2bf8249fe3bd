"""Files of an identification: arm, covariance, identification.json, residuals.csv."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import (
    Arm,
    arm_digest,
    geometry_digest,
    write_arm,
)
from traverse.kinematics.arm_file.arm import Identification as Provenance
from traverse.lab.campaign.poses import texts
from traverse.lab.campaign.prior import family_json
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.identification.results.result import ArtefactResult, Identification
from traverse.lab.outcomes.adjustment import COVARIANCE_FILE, write_covariance
from traverse.lab.outcomes.identified import IdentificationFigures
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.report.quantities import picked, plain_values
from traverse.lab.statistics.outlier_clusters import ExcludedCluster
from traverse.strict_toml.writing import write_atomically

SCHEMA = "traverse/identification/1"


IDENTIFICATION = "identification.json"


IDENTIFICATION_FILES = (
    "arm.toml",
    COVARIANCE_FILE,
    IDENTIFICATION,
    "residuals.csv",
    "report.html",
)


def write_result(
    result: Identification,
    folder: str | Path,
    when: datetime | None = None,
    provenance: ReportProvenance | None = None,
) -> Arm:
    """Write everything but the report into a folder, which is made if need be.

    Date and provenance are by default those of now and this user. Returns the arm as
    written, with its provenance.
    """
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    covariance_digest = write_covariance(result.cartesian, target / COVARIANCE_FILE)
    arm = identified_arm(result, when or datetime.now(UTC), covariance_digest)
    write_arm(target / "arm.toml", arm)
    values = identification_json(result, provenance)
    text = json.dumps(values, indent=1, allow_nan=False)
    write_atomically(target / IDENTIFICATION, text + "\n")
    _write_residuals(result, target / "residuals.csv")
    return arm


def identified_arm(result: Identification, when: datetime, covariance: str) -> Arm:
    """Return the arm with its provenance, the digest of the covariance in it."""
    provenance = Provenance(
        sigma0=result.sigma0,
        redundancy=result.redundancy,
        date=when.replace(microsecond=0),
        campaign_digest=result.campaign.digest or None,
        **result.campaign.temperature_range_c,
        design_digest=arm_digest(result.design),
        parameters=tuple(entry.name for entry in result.parameters),
        covariance_file=COVARIANCE_FILE,
        covariance_digest=covariance,
        arm_digest=geometry_digest(result.arm),
    )
    return result.arm.model_copy(update={"identification": provenance})


def identification_json(
    result: Identification, provenance: ReportProvenance | None = None
) -> dict[str, Any]:
    judged = outcome_of(result)
    return {
        "schema": SCHEMA,
        "provenance": (provenance or result.campaign.provenance()).values,
        **plain_values(judged.outcome),
        **plain_values(figures_of(result, judged.title)),
    }


def figures_of(result: Identification, verdict: str) -> IdentificationFigures:
    orientations, shift = result.orientations, result.contact_shift
    serial = result.serial_noise
    return IdentificationFigures(
        inputs={
            "arm_digest": arm_digest(result.design),
            **picked(result.options, "hold", "free"),
        },
        verdict=verdict,
        converged=result.converged,
        iterations=len(result.iterations),
        sigma0=result.sigma0,
        redundancy=result.redundancy,
        global_test=picked(result.global_test, "p_value", "passed", "noise_estimated"),
        rms_mm={"before": result.rms_before_mm, "after": result.rms_after_mm},
        parameters=result.parameters,
        undetermined=[
            picked(entry, "direction", "probe_mm", "why")
            for entry in result.undetermined
        ],
        weak=result.weak,
        artefacts={entry.id: _artefact(entry) for entry in result.artefacts},
        tools=result.tools,
        excluded=result.excluded,
        orientations=None if orientations is None else orientations.values,
        holdout=result.holdout,
        mass_distribution=result.adjustment.mass_distribution() or None,
        alternating=result.alternating,
        contradictions=result.contradictions,
        contact_shift=None
        if shift is None
        else picked(
            shift, "artefacts", "shift_mm", sigmas="evidence", rivals="or_else"
        ),
        wrong_signs=result.wrong_signs,
        lost_poses={
            entry.artefact: picked(entry, "n_lost", n="n_poses")
            for entry in result.lost_poses
        },
        clusters=[_together(entry) for entry in result.clusters],
        still_moving={} if result.converged else result.moving,
        noise={
            "encoder_rad": result.noise.encoder_rad,
            "contact_mm": {entry.id: entry.contact_mm for entry in result.artefacts},
        },
        serial_noise=None
        if serial is None
        else picked(serial, "lasts_s", "samples_per_mean", "samples_per_square"),
        condition_number=result.condition_number,
        zero_offsets_rad=result.zero_offsets_rad,
        coverage=[
            picked(entry, "joint", "least_rad", "largest_rad", "part_of_turn")
            for entry in result.coverage
        ],
        suggestions=result.suggestions,
        **family_json(result.campaign.prior),
    )


def _together(entry: ExcludedCluster) -> dict[str, Any]:
    names = ("covariate", "joint", "artefact", "low", "high", "n_excluded")
    return {
        **picked(entry.cluster, *names, n="n_poses"),
        "log10_p": entry.cluster.log_p / float(np.log(10.0)),
        "taken_back": entry.taken_back,
    }


def _artefact(entry: ArtefactResult) -> dict[str, Any]:
    values: dict[str, Any] = {
        "n": entry.n_poses,
        "rms_mm": entry.rms_mm,
        "n_all": entry.n_all,
        "rms_all_mm": entry.rms_all_mm,
    }
    if entry.mean_distance_mm is not None:
        values["mean_distance_mm"] = entry.mean_distance_mm
        values["mean_distance_all_mm"] = entry.mean_distance_all_mm
    for length in entry.lengths:
        values[length.name] = {"value": length.value_mm, "std": length.std_mm}
    values["place"] = dict(entry.place)
    return values


def _write_residuals(result: Identification, path: Path) -> None:
    """Write one line a pose: misclosures, tests, corrections of the readings."""
    campaign, statistics = result.campaign, result.statistics
    header = [
        *("w1_mm", "w2_mm", "w3_mm", "w", "controllability", "detectable_mm"),
        "excluded",
        *(f"{name}_correction_rad" for name in campaign.joint_names),
    ]
    columns = (statistics.misclosures_mm, statistics.w, statistics.controllability)
    numbers = np.column_stack([*columns, statistics.detectable_mm])
    excluded = (~result.included).astype(int)
    per_pose = statistics.corrections_rad
    if (of := result.orientations) is not None:
        header += [f"orientation_{axis}_rad" for axis in "xyz"]
        header += ["w_position", "w_orientation", "orientation_excluded"]
        measured = np.isfinite(of.errors_rad[:, 0])
        left_out = np.where(measured, (~of.used).astype(float), np.nan)
        tests = (
            of.errors_rad,
            statistics.w_position,
            statistics.w_orientation,
            left_out,
        )
        per_pose = np.column_stack([per_pose, *tests])
    campaign.write_table(
        path,
        header,
        lambda row: [*texts(numbers[row]), str(excluded[row]), *texts(per_pose[row])],
    )

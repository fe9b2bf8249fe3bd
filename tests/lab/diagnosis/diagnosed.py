"""Diagnoses of simulated campaigns, made once for all tests of the report."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.lab.diagnosis.fitted_rows import Measurement, measured
from tests.shared import shared
from traverse.kinematics.arm_file.arm import effect_from_table, write_arm
from traverse.lab.diagnosis.diagnose import DiagnosisOptions, diagnose
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.files import write_diagnosis

START = datetime(2026, 11, 20, 9, tzinfo=UTC)
OPTIONS = DiagnosisOptions(seed=3, n_draws=200)
# Quicker: the decision alone.
DECISION = DiagnosisOptions(seed=3, n_draws=200, details=False)
COS_RAD, SIN_RAD = 3.0e-5, -1.2e-5
ECCENTRIC = {
    "kind": "encoder_eccentricity",
    "joint": "J3",
    "cos_rad": COS_RAD,
    "sin_rad": SIN_RAD,
}


def eccentric_campaign() -> Measurement:
    """Readings of J3 are wrong, one pose is a blunder."""
    measurement = measured().with_effect(effect_from_table(ECCENTRIC))
    angles_rad = measurement.campaign.poses.angles_rad.copy()
    angles_rad[100, 1] += 2e-3
    measurement = measurement.with_poses(angles_rad=angles_rad)
    return replace(measurement, campaign=replace(measurement.campaign, start_utc=START))


@shared
def eccentric() -> Diagnosis:
    """Of that campaign."""
    measurement = eccentric_campaign()
    return diagnose(measurement.campaign, measurement.arm, OPTIONS)


@shared
def clean() -> Diagnosis:
    """Of a campaign in which nothing is hidden."""
    measurement = measured()
    return diagnose(measurement.campaign, measurement.arm, DECISION)


@shared
def drifting() -> Diagnosis:
    """The base drifts, and the campaign's start is unknown."""
    table = {
        "kind": "base_drift",
        "rate_mm_s": [3e-5, 0.0, 5e-5],
        "epoch_utc": datetime(2000, 1, 1, tzinfo=UTC),
    }
    measurement = measured().with_effect(effect_from_table(table))
    return diagnose(measurement.campaign, measurement.arm, DECISION)


# Of the file of the arm.
COMMENT = "# The arm in the cellar."
WHEN = datetime(2026, 11, 21, 8, 0, tzinfo=UTC)


def write_source(path: Path) -> None:
    """Write the arm file that the diagnosis of the eccentricity began with."""
    write_arm(path, eccentric().arm)
    path.write_text(f"{COMMENT}\n{path.read_text('utf-8')}", "utf-8")


@shared
def written_files() -> dict[str, bytes]:
    """Write that diagnosis over an earlier one; files by name."""
    with TemporaryDirectory() as name:
        source, out = Path(name) / "bench.toml", Path(name) / "out"
        write_source(source)
        out.mkdir()
        (out / "term-7.png").write_bytes(b"of an earlier diagnosis")
        write_diagnosis(out, eccentric(), source, WHEN)
        return {path.name: path.read_bytes() for path in out.iterdir()}

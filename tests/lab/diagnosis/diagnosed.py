"""Diagnoses of simulated campaigns, made once for all tests of the report."""

from dataclasses import replace
from datetime import UTC, datetime
from functools import cache

from tests.lab.diagnosis.fitted_rows import Measurement, measured
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.diagnose import DiagnosisOptions, diagnose
from traverse.lab.diagnosis.model.result import Diagnosis

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
    found = measured().with_effect(effect_from_table(ECCENTRIC))
    angles_rad = found.campaign.poses.angles_rad.copy()
    angles_rad[100, 1] += 2e-3
    found = found.with_poses(angles_rad=angles_rad)
    return replace(found, campaign=replace(found.campaign, start_utc=START))


@cache
def eccentric() -> Diagnosis:
    """Of that campaign."""
    found = eccentric_campaign()
    return diagnose(found.campaign, found.arm, OPTIONS)


@cache
def clean() -> Diagnosis:
    """Of a campaign in which nothing is hidden."""
    found = measured()
    return diagnose(found.campaign, found.arm, DECISION)


@cache
def drifting() -> Diagnosis:
    """The base drifts, and the campaign's start is unknown."""
    table = {
        "kind": "base_drift",
        "rate_mm_s": [3e-5, 0.0, 5e-5],
        "epoch_utc": datetime(2000, 1, 1, tzinfo=UTC),
    }
    found = measured().with_effect(effect_from_table(table))
    return diagnose(found.campaign, found.arm, DECISION)

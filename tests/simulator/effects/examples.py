"""One effect of every kind, of a size that a real arm might have."""

from datetime import UTC, datetime

from tests.simulator.campaigns.arms import seven_joint_arm
from traverse.kinematics.arm_file.arm import Arm, Effect, effect_from_table
from traverse.simulator.campaigns import CampaignSpec, ConditionTable

START = datetime(2026, 11, 20, 9, 0, tzinfo=UTC)


def heavy_arm() -> Arm:
    """The seven-joint arm with masses, one of them off the middle of its element."""
    arm = seven_joint_arm()
    joints = [j.model_copy(update={"mass_kg": 1.0}) for j in arm.joints]
    off = {"centre_of_mass_mm": (150.0, 20.0, -10.0)}
    joints[2] = joints[2].model_copy(update=off)
    probe = arm.probe.model_copy(
        update={"mass_kg": 0.3, "vector_mm": (5.0, -4.0, -30.0)}
    )
    return arm.model_copy(update={"joints": tuple(joints), "probe": probe})


# Name of the example, and the table; J3 turns about x, J4 about y in the base posture.
TABLES = {
    "encoder_eccentricity": {"joint": "J4", "cos_rad": 2e-4, "sin_rad": -1e-4},
    "encoder_harmonic": {"joint": "J2", "order": 3, "cos_rad": 1e-4, "sin_rad": 1e-4},
    "transmission_error": {
        "joint": "J2",
        "cycles": 101.5,
        "cos_rad": 1e-4,
        "sin_rad": 1e-4,
    },
    "encoder_scale": {"joint": "J3", "scale_ppm": 150.0},
    "encoder_temperature": {"joint": "J1", "rate_rad_c": 5e-5},
    "encoder_drift": {"joint": "J2", "rate_rad_s": 5e-7, "epoch_utc": START},
    "count_slip": {"joint": "J4", "at_s": 90.0, "step_rad": 3e-4, "epoch_utc": START},
    "encoder_latency": {"latency_s": 2e-3},
    "backlash": {"joint": "J4", "half_width_rad": 1e-4},
    "joint_compliance": {"joint": "J2", "compliance_rad_nm": 5e-5},
    "bearing_compliance": {"joint": "J4", "compliance_rad_nm": 2e-4},
    "mount_compliance": {"compliance_rad_nm": 5e-5},
    "first_moment": {"joint": "J4", "moment_kg_m": [0.9, 0.1, -0.2]},
    "thermal_expansion": {"expansion_per_c": 1.2e-4},
    "axis_wobble": {
        "joint": "J3",
        "order": 2,
        "cos_rad": [0.0, 1e-4, -5e-5],
        "sin_rad": [0.0, 2e-5, 1e-4],
    },
    "axis_runout": {
        "joint": "J2",
        "component": "radial",
        "order": 2,
        "cos_mm": [0.03, 0.0, 0.02],
        "sin_mm": [-0.02, 0.0, 0.05],
    },
    "probe_radius": {"radius_error_mm": 0.05},
    "probe_lobing": {"amplitude_mm": 0.03, "phase_rad": 0.7},
    "stylus_bending": {"compliance_mm_n": 0.05},
    "base_drift": {"rate_mm_s": [1e-4, -2e-4, 5e-5], "epoch_utc": START},
    "base_step": {"at_s": 100.0, "step_mm": [0.05, -0.02, 0.1], "epoch_utc": START},
    "artefact_length": {"artefact": "bar", "error_ppm": 80.0},
    "empirical": {
        "joint": "J2",
        "covariate": "J4_rad",
        "knots": [-1.5, 0.0, 1.0, 2.5, 4.0],
        "values_rad": [1e-4, -5e-5, 1e-4, 2e-4, -1e-4],
    },
}


def example(kind: str, **changes: object) -> Effect:
    return effect_from_table({"kind": kind, **TABLES[kind], **changes})


def diagnosis_conditions() -> ConditionTable:
    """Warm and cold, fast and slow, hard and soft."""
    return ConditionTable(swing_c=2.0, drift_c=1.0, speed_rad_s=0.1, start_utc=START)


def spec_of(*artefacts: object) -> CampaignSpec:
    return CampaignSpec(artefacts=artefacts, conditions=diagnosis_conditions())

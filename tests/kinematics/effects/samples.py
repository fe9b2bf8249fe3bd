"""An arm with every kind of effect, and blocks with all that they need."""

import numpy as np

from tests.kinematics.effects.reference import (
    EPOCH,
    EPOCH_NS,
    N_JOINTS,
    T_REF,
    effect,
    random_arm,
    random_readings,
)
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.geometry import geometry_from_arm

ARM = random_arm(31)
GEOMETRY = geometry_from_arm(ARM)


def vectors(joint, size, seed):
    """Two vectors across the axis of a joint."""
    axis = GEOMETRY.axes[joint]
    across = np.cross(axis, np.random.default_rng(seed).normal(size=(2, 3)))
    return [*(size * across[0])], [*(size * across[1])]


WOBBLE = vectors(1, 2e-5, seed=1)
RUNOUT = vectors(3, 5e-3, seed=2)
AXIAL = [*(2e-3 * GEOMETRY.axes[2])], [*(-1e-3 * GEOMETRY.axes[2])]

EVERY_KIND = (
    effect("encoder_eccentricity", joint="J3", cos_rad=3e-5, sin_rad=-1.2e-5),
    effect("encoder_harmonic", joint="J1", order=2, cos_rad=1e-5, sin_rad=2e-5),
    effect("transmission_error", joint="J4", cycles=7.5, cos_rad=2e-5, sin_rad=-1e-5),
    effect("encoder_scale", joint="J2", scale_ppm=12.0),
    effect("encoder_temperature", joint="J4", rate_rad_c=3e-6),
    effect("encoder_drift", joint="J5", rate_rad_s=1e-8, epoch_utc=EPOCH),
    effect("count_slip", joint="J6", at_s=30.0, step_rad=4e-5, epoch_utc=EPOCH),
    effect("encoder_latency", latency_s=5e-5),
    effect("encoder_latency", joint="J2", latency_s=2e-5),
    effect("backlash", joint="J2", half_width_rad=1e-5),
    effect("joint_compliance", joint="J2", compliance_rad_nm=2e-6),
    effect("bearing_compliance", joint="J3", compliance_rad_nm=3e-6),
    effect("mount_compliance", compliance_rad_nm=1e-6),
    effect("first_moment", joint="J3", moment_kg_m=[0.6, -0.2, 0.3]),
    effect("thermal_expansion", expansion_per_c=1e-5),
    effect("thermal_expansion", joint="J6", expansion_per_c=2e-5),
    effect("axis_wobble", joint="J2", order=2, cos_rad=WOBBLE[0], sin_rad=WOBBLE[1]),
    effect(
        "axis_runout",
        joint="J4",
        component="radial",
        order=2,
        cos_mm=RUNOUT[0],
        sin_mm=RUNOUT[1],
    ),
    effect(
        "axis_runout",
        joint="J3",
        component="axial",
        order=1,
        cos_mm=AXIAL[0],
        sin_mm=AXIAL[1],
    ),
    effect("probe_radius", radius_error_mm=0.002),
    effect("probe_lobing", amplitude_mm=0.003, phase_rad=0.7),
    effect("stylus_bending", compliance_mm_n=0.01),
    effect("base_drift", rate_mm_s=[1e-5, 0.0, -2e-5], epoch_utc=EPOCH),
    effect("base_step", at_s=45.0, step_mm=[0.02, -0.01, 0.0], epoch_utc=EPOCH),
    effect("artefact_length", artefact="bar", error_ppm=3.0),
    effect(
        "empirical",
        joint="J5",
        covariate="J6_rad",
        knots=[-3.0, -1.0, 1.0, 3.0],
        values_rad=[1e-5, -1e-5, 2e-5, 0.0],
    ),
)
CAMPAIGN = (EPOCH, EPOCH.replace(hour=10))


def full_block(seed, n_samples):
    rng = np.random.default_rng(seed)
    shape = (n_samples, N_JOINTS)
    directions = rng.normal(size=(n_samples, 3))
    return Block(
        angles_rad=random_readings(seed, n_samples),
        speeds_rad_s=rng.normal(size=shape),
        approaches=rng.choice([-1.0, 0.0, 1.0], size=shape),
        temperature_c=T_REF + rng.uniform(-5, 5, n_samples),
        joint_temperatures_c=np.where(
            rng.uniform(size=shape) < 0.5, np.nan, T_REF + rng.uniform(-5, 5, shape)
        ),
        utc_ns=EPOCH_NS + rng.integers(0, 90 * 10**9, n_samples),
        campaign_s=rng.uniform(0, 90, n_samples),
        directions=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        force_n=rng.uniform(0.1, 2, n_samples),
    )

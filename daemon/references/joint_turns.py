"""Joints whose whole turns move the probe, or are fixed by end stops."""

import numpy as np

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.covariates import CovariateBuilder
from traverse.kinematics.effects.pose import corrected_pose

SAME_MM = 1e-6  # rounding moves the ball by less, an effect that matters by more
POSTURES_RAD = (0.3, 1.1)  # from the base posture, times the joint's number


def turn_dependent_joints(
    section: QualitySection, model: ArmModel, clock: HostClock
) -> tuple[int, ...]:
    """Return the joints, from 0, of which a whole turn would move the probe.

    Joints whose end stops leave only the turn nearest to zero are excluded.
    """
    zeros_rad = model.geometry.zeros_rad
    n_joints = len(zeros_rad)
    moved = np.zeros(n_joints, dtype=np.bool_)
    turns_rad = 2.0 * np.pi * np.vstack([np.zeros(n_joints), np.eye(n_joints)])
    for share in POSTURES_RAD:
        posture_rad = zeros_rad + share * np.arange(1, n_joints + 1)
        times_ns = np.full(n_joints + 1, clock.monotonic_ns())
        angles_rad, quality = posture_rad + turns_rad, np.zeros(n_joints + 1, np.uint32)
        builder = CovariateBuilder(model, clock)
        motion = builder.motion(times_ns, angles_rad, quality)
        block, _ = builder.block(
            times_ns, angles_rad, model.reference_temperature_c, quality, motion
        )
        xyz_mm, _, _ = corrected_pose(model.geometry, model.effects, block)
        moved |= np.linalg.norm(xyz_mm[1:] - xyz_mm[0], axis=1) > SAME_MM

    excluded = one_turn_joints(section, model)
    return tuple(j for j in np.flatnonzero(moved).tolist() if j not in excluded)


def one_turn_joints(section: QualitySection, model: ArmModel) -> tuple[int, ...]:
    """Return the joints, from 0, whose end stops leave only the zero turn."""
    zeros_rad = model.geometry.zeros_rad
    joints = {name: joint for joint, name in enumerate(model.effects.joint_names)}
    return tuple(
        joint
        for stop in section.end_stops
        if (joint := joints.get(stop.joint)) is not None
        and stop.low_rad >= zeros_rad[joint] - np.pi
        and stop.high_rad <= zeros_rad[joint] + np.pi
    )

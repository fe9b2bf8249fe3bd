"""Errors of touches: what an arm file states of them, and what they share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.kinematics.arm_file.arm import Arm, Effect, arm_digest
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import Span
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_columns,
    read_parameter_covariance,
)
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_uncertainties,
)
from traverse.lab.campaign.campaign import Campaign
from traverse.protocol.messages import Point


@dataclass(frozen=True, slots=True, eq=False)
class KnownArm:
    """An arm with the covariance of its parameters.

    Attributes:
        effects: Those of poses.
    """

    arm: Arm
    effects: ArmEffects
    covariance: ArmCovariance


def effects_of_poses(arm: Arm) -> tuple[Effect, ...]:
    """Leave out the effects of standards: their certificates say how long they are."""
    kinds = EFFECT_KINDS
    return tuple(each for each in arm.effects if kinds[each.kind].effect_class != "O")


def known_arm(path: Path, arm: Arm, span: Span | None) -> KnownArm:
    """Read the covariance beside an arm file.

    The span of a campaign is for effects that are bound to its time.

    Raises:
        ValueError: There is none, or it is of another arm; says what to do.
    """
    effects = effects_of(arm, effects_of_poses(arm), span)
    covariance = read_parameter_covariance(
        path, arm, effects_of(arm, arm.effects, span), effects
    )
    if covariance is None:
        raise ValueError(f"{path} names no covariance_file; `traverse identify` does")
    return KnownArm(arm, effects, covariance)


def shared_by_points(points: Sequence[Point], path: Path, arm: Arm) -> Floats:
    """Compute what n points share by the parameters of the arm of a file.

    Returns:
        Factors S of `JointCovariance`, (n, 3, rank).

    Raises:
        ValueError: Says why it cannot be known.
    """
    if {point.model for point in points} != {arm_digest(arm)}:
        raise ValueError(f"the points were not taken with {path} as it is")
    known = known_arm(path, arm, None)
    warm_c = [np.nan if p.temperature_c is None else p.temperature_c for p in points]
    block = Block(
        np.array([point.angles_rad for point in points]),
        temperature_c=np.array(warm_c),
        utc_ns=np.array([point.time_ns for point in points], dtype=np.int64),
    )
    geometry = geometry_from_arm(arm)
    by_parameters, _ = parameter_columns(geometry, known.effects, block)
    shared: Floats = by_parameters @ known.covariance.factor
    return shared


def errors_of_poses(
    campaign: Campaign, rows: Integers, places_mm: Floats, path: Path, arm: Arm
) -> JointCovariance:
    """State the errors of poses of a campaign, by its noise and by the arm of a file.

    Rows of the poses, (n,), and places of the ball, (n, 3); readings are uncorrected.

    Raises:
        ValueError: Says what is not known, and where to state it.
    """
    encoder_rad, contact_mm = campaign.encoder_rad, campaign.contact_mm
    if encoder_rad is None or contact_mm is None:
        raise ValueError(
            "campaign.toml states no encoder_rad and contact_mm in [noise]"
        )
    known = known_arm(path, arm, campaign.span)
    n_joints = len(arm.joints)
    noise = PointNoise(
        np.full(n_joints, encoder_rad), np.zeros(n_joints), contact_mm, 0.0
    )
    uncertainties = point_uncertainties(
        geometry_from_arm(arm),
        known.effects,
        campaign.block().part(rows),
        noise,
        known.covariance,
    )
    return JointCovariance(
        places_mm, uncertainties.covariances_mm2, uncertainties.shared_mm
    )

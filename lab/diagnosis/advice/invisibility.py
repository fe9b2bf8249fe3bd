"""Why an effect cannot be seen at all, in words."""

import numpy as np

from traverse.kinematics.effect_table import EFFECT_KINDS, EffectKind, Family
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.diagnosis.candidates.scoring import LEAST_SINGULAR_VALUE
from traverse.lab.diagnosis.model.candidate import Candidate
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations

# An axis within that of the direction of gravity is vertical.
_VERTICAL = 0.02
# A probe nearer to an axis than that lies on it, whatever the posture.
_ON_AXIS_MM = 0.5
_STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


def reason(rows: ObservationEquations, candidate: Candidate, moved: float) -> str:
    """Say why nothing is seen of an effect.

    Args:
        rows: Of the fit.
        candidate: The effect.
        moved: How much a plausible one changes the rows, in standard deviations of
            the noise, unknowns not adjusted.
    """
    joint = candidate.joint
    row = EFFECT_KINDS[candidate.kind]
    equals = f"equals {row.absorbed_by.format(joint=joint)}"
    if row.family is Family.LENGTH:
        return f"nothing else tells how long a millimetre is: it {equals}"
    if joint is not None:
        if _twists(row) and is_vertical(rows, joint):
            return f"{joint} is vertical: gravity does not twist it"
        if row.acts_on == "angle" and probe_is_on_axis(rows, joint):
            return f"the probe lies on the axis of {joint}: its angle moves nothing"
    if moved > LEAST_SINGULAR_VALUE:
        return equals
    return "it moves the probe by far less than the noise in these poses"


def _twists(row: EffectKind) -> bool:
    """Say whether gravity turns the joint about its own axis."""
    return row.family is Family.GRAVITY and row.acts_on == "angle"


def is_vertical(rows: ObservationEquations, joint: str) -> bool:
    """Say whether a joint's axis stays along gravity."""
    campaign = rows.adjustment.network.campaign
    # The arm's own gravity is not part of a fit; without an override it is usual.
    gravity = np.array(campaign.gravity_m_s2 or _STANDARD_GRAVITY)
    at = campaign.joint_names.index(joint)
    axis = rows.adjustment.state.arm.geometry.axes[at]
    across = np.linalg.norm(np.cross(axis, gravity)) / np.linalg.norm(gravity)
    return at == 0 and bool(across < _VERTICAL)


def probe_is_on_axis(rows: ObservationEquations, joint: str) -> bool:
    """Say whether a turn of a joint moves the probe in no pose."""
    campaign = rows.adjustment.network.campaign
    geometry = rows.adjustment.state.arm.geometry
    by_angles = probe_derivatives(geometry, rows.block.angles_rad).by_angles
    moved_mm = np.linalg.norm(
        by_angles[:, :, campaign.joint_names.index(joint)], axis=1
    )
    return bool(np.max(moved_mm, initial=0.0) < _ON_AXIS_MM)

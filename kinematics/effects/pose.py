"""The corrected pose: readings to the probe with all effects of an arm.

    d_alpha    sum of the reading corrections, of readings as they are
    theta      alpha - zero - d_alpha, of coupled joints plus ratio that of the other
    amounts    sums of the mechanical effects, of the undeflected posture theta
    pose       the deflected arm
    contact    shift of the ball's centre, where the surface is known

The kernel in C computes it where it was built, but for the contact; the code here in
NumPy is the readable definition, and computes where it was not. Both agree within the
last digits.

Effects of one stage do not depend on one another, so the order of the arm file is that
of the adding up and no more than a last bit depends on it. A sample's result does not
depend on the block it comes in, bit for bit.
"""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.bodies import M_PER_MM
from traverse.kinematics.effects.base.contact import contact_seen
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.effects.deflection import Deflection, deflection, totals
from traverse.kinematics.model.forward import chunks, numpy_pose, probe_pose
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.kernel_choice import (
    KERNEL,
    aligned_floats,
    compiled_chain,
)
from traverse.kinematics.model.quaternion import rotate

if KERNEL != "numpy":
    from traverse.kinematics.kernel.compiled import DeflectedChain


def compiled_pose(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, Floats] | None:
    """Compute the pose with the effects of readings and bodies, not of contacts.

    Returns:
        Centres in mm and directions, both (n_samples, 3); None if NumPy is to compute.
    """
    if compiled_chain(geometry) is None:
        return None
    if geometry.couplings:
        block = replace(block, angles_rad=_hinge_readings(geometry, effects, block))
    gravity = block.gravity_m_s2
    return _chain(geometry, effects).poses(
        _readable(block),
        (effects.gravity_m_s2 if gravity is None else gravity).tolist(),
    )


def _readable(block: Block) -> Block:
    """Return the block; columns are copied only if the kernel cannot read them."""
    changes: dict[str, Any] = {}
    for field in fields(block):
        column = getattr(block, field.name)
        if column is None or field.name == "utc_ns":
            continue
        floats = aligned_floats(column)
        if floats is not column:
            changes[field.name] = floats
    return replace(block, **changes) if changes else block


# Neither ever changes, and most calls are for the same arm.
@lru_cache(maxsize=8)
def _chain(geometry: Geometry, effects: ArmEffects) -> "DeflectedChain":
    # Coupled readings are corrected before: the kernel knows nothing of couplings.
    readings = () if geometry.couplings else effects.readings
    terms = [term for correction in readings for term in correction.terms]
    terms += [term for correction in effects.mechanical for term in correction.terms]
    levers_kg_m = M_PER_MM * effects.levers_kg_mm(geometry)
    return DeflectedChain(geometry, KERNEL, terms, levers_kg_m)


# Samples computed at a time, so that the intermediate arrays stay in the cache.
_CHUNK_SAMPLES = 256


@dataclass(frozen=True, slots=True, eq=False)
class PoseFlags:
    """Flags of samples; each (n_samples,).

    Attributes:
        stale_effect: A drift is held, since the time is outside its campaign.
        surface_unknown: An effect of the contact could not be applied.
        empirical: A curve without a physical name was applied.
        beyond_knots: Such a curve is held, since its covariate is beyond it.
    """

    stale_effect: Booleans
    surface_unknown: Booleans
    empirical: Booleans
    beyond_knots: Booleans


def corrected_pose(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, Floats, PoseFlags]:
    """Compute ball centres and shank directions, effects applied.

    Returns:
        Centres of the ball in mm and unit directions of the shank, both
        (n_samples, 3), and flags.

    Raises:
        ValueError: the block lacks inputs; names all of them.
    """
    checked(geometry, effects, block)
    if not effects.corrections:
        nothing = np.zeros(len(block), dtype=np.bool_)
        nothing.setflags(write=False)
        flags = PoseFlags(nothing, nothing, nothing, nothing)
        return *probe_pose(geometry, block.angles_rad), flags
    flags = pose_flags(effects, block)
    pose = compiled_pose(geometry, effects, block)
    if pose is None:
        return *numpy_corrected_pose(geometry, effects, block), flags
    centres_mm, directions = pose
    if effects.contacts and block.directions is not None:
        centres_mm += _contact_shifts(geometry, effects, block)
    return centres_mm, directions, flags


def numpy_corrected_pose(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> tuple[Floats, Floats]:
    """Compute `corrected_pose` in NumPy, of a checked block."""
    if not effects.mechanical and not effects.contacts:
        # The plain arm at other readings.
        return numpy_pose(geometry, _hinge_readings(geometry, effects, block))
    centres_mm = np.empty((len(block), 3))
    directions = np.empty((len(block), 3))
    shank = geometry.probe_direction[:, np.newaxis]
    for chunk in chunks(len(block), _CHUNK_SAMPLES):
        part = block if len(block) <= _CHUNK_SAMPLES else block.part(chunk)
        arm = deflected_arm(geometry, effects, part)
        shifted_mm = arm.centres_mm
        if effects.contacts and block.directions is not None:
            shifted_mm = shifted_mm + _shift_mm(effects, part, arm)
        centres_mm[chunk] = shifted_mm.T
        directions[chunk] = rotate(arm.rotations[:, -1], shank).T
    return centres_mm, directions


def corrected_rotations(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> Floats:
    """Compute the rotation of the last body, effects applied, (4, n_samples).

    Raises:
        ValueError: the block lacks inputs; names all of them.
    """
    checked(geometry, effects, block)
    rotations = np.empty((4, len(block)))
    for chunk in chunks(len(block), _CHUNK_SAMPLES):
        arm = deflected_arm(geometry, effects, block.part(chunk))
        rotations[:, chunk] = arm.rotations[:, -1]
    return rotations


def angle_corrections(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    """Compute d_alpha, the sum of all reading corrections, (n_samples, n_joints)."""
    checked(geometry, effects, block)
    return np.ascontiguousarray(_d_alpha_rad(geometry, effects, block).T)


def corrected_readings(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    """Subtract all reading corrections, (n_samples, n_joints) [rad]."""
    if not effects.readings:
        return block.angles_rad
    return block.angles_rad - angle_corrections(geometry, effects, block)


def contact_shifts(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    """Compute the shifts of the ball's centre that depend on the surface.

    For directions that are known after the pose: the difference of `corrected_pose`
    with and without them.

    Args:
        geometry: the arm.
        effects: of the same arm.
        block: with directions (NaN where unknown: no shift there).

    Returns:
        mm, (n_samples, 3).
    """
    checked(geometry, effects, block)
    return _contact_shifts(geometry, effects, block)


def pose_flags(effects: ArmEffects, block: Block) -> PoseFlags:
    flags = {
        field.name: np.zeros(len(block), dtype=np.bool_) for field in fields(PoseFlags)
    }
    for correction in effects.corrections:
        for name, is_flagged in correction.flags(block):
            flags[name] |= is_flagged
    return PoseFlags(**flags)


def undeflected_posture(
    geometry: Geometry, effects: ArmEffects, block: Block
) -> Posture:
    # Contiguous, as `Block.rows` says.
    readings_rad = np.ascontiguousarray(_hinge_readings(geometry, effects, block).T)
    gravity = block.gravity_m_s2
    return Posture(
        geometry=geometry,
        block=block,
        levers_kg_mm=effects.levers_kg_mm(geometry),
        gravity_m_s2=effects.gravity_m_s2 if gravity is None else gravity,
        turns_rad=readings_rad - geometry.zeros_rad[:, np.newaxis],
    )


def deflected_arm(geometry: Geometry, effects: ArmEffects, block: Block) -> Deflection:
    """Apply corrections of readings and bodies to one part of a block."""
    posture = undeflected_posture(geometry, effects, block)
    amounts = totals(effects.mechanical, posture)
    return deflection(geometry, posture.turns_rad, amounts)


def checked(geometry: Geometry, effects: ArmEffects, block: Block) -> None:
    """Check that a block is of this arm and has all inputs of effects.

    Raises:
        ValueError: lists everything that is missing.
    """
    if not geometry.n_joints == block.n_joints == len(effects.joint_names):
        raise ValueError(
            f"block has {block.n_joints} joints, the geometry {geometry.n_joints}, the "
            f"effects {len(effects.joint_names)}; expected those of one arm"
        )
    lacks = [] if effects.are_served_by(block) else list(effects.lacks(block))
    if lacks:
        raise ValueError(
            "effects cannot be applied; give what they need or take them out of the "
            "arm file:\n" + "\n".join(lacks)
        )


def _hinge_readings(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    """Correct the readings and couple them, (n_samples, n_joints) [rad]."""
    readings_rad = block.angles_rad
    if effects.readings:
        readings_rad = readings_rad - _d_alpha_rad(geometry, effects, block).T
    return geometry.hinge_readings(readings_rad)


def _d_alpha_rad(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    """Sum of all reading corrections, (n_joints, n_samples)."""
    total_rad = np.zeros((geometry.n_joints, len(block)))
    for correction in effects.readings:
        total_rad[correction.joints] += correction.amount(geometry, block)
    return total_rad


def _shift_mm(effects: ArmEffects, block: Block, arm: Deflection) -> Floats:
    contact = contact_seen(arm.geometry, block, arm.rotations[:, -1])
    total_mm = np.zeros((3, len(block)))
    for correction in effects.contacts:
        total_mm += correction.amount(contact)
    return total_mm


def _contact_shifts(geometry: Geometry, effects: ArmEffects, block: Block) -> Floats:
    shifts_mm = np.zeros((len(block), 3))
    if effects.contacts:
        for chunk in chunks(len(block), _CHUNK_SAMPLES):
            part = block.part(chunk)
            arm = deflected_arm(geometry, effects, part)
            shifts_mm[chunk] = _shift_mm(effects, part, arm).T
    return shifts_mm

"""How the corrected ball's centre moves with the parameters of effects.

With Q_k, a_k = Q_k u_k and rho_k = x - o_k of the deflected arm, an amount moves x by

    reading   -(a_k x rho_k) d_alpha          tilt    (Q_(k-1) w) x rho_k
    turn       (a_k x rho_k) e                shift    Q_(k-1) d
    growth     Q_k r_k g                      mount    m x (x - x_0 - b)
    contact    the shift itself               base     b
    moment     what yields to its weight

and a column is for the unit amount. The last body is turned by the same without
levers: - a_k d_alpha, a_k e, Q_(k-1) w and m. Left out is how the mechanical effects
change with the corrections of the readings, and how small turns about one joint
combine: both are of the second order, some 1e-4 of a column at amplitudes of 1e-4 rad.
"""

from collections.abc import Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.contact import Contact, contact_seen
from traverse.kinematics.effects.base.correction import (
    BodyCorrection,
    ContactCorrection,
    Correction,
    ReadingCorrection,
    Target,
)
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.effects.deflection import Deflection, deflection, totals
from traverse.kinematics.effects.mechanics.deformations import Compliance, FirstMoment
from traverse.kinematics.effects.pose import checked, undeflected_posture
from traverse.kinematics.model.forward import chunks
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.quaternion import cross, rotate

_CHUNK_SAMPLES = 512


def columns(
    geometry: Geometry,
    effects: ArmEffects,
    block: Block,
    candidates: Sequence[Correction] | None = None,
    yielding: Sequence[Compliance] | None = None,
    *,
    turns: bool = False,
) -> Floats:
    """Differentiate the corrected ball's centres.

    Args:
        geometry: the arm.
        effects: applied ones.
        block: the samples with inputs of effects and candidates.
        candidates: effects to differentiate for instead, applied or not.
        yielding: compliances that first moments act on, instead of those applied.
        turns: differentiate the orientation of the last body instead.

    Returns:
        mm (of the orientation rad) per unit of each parameter, (n_samples, 3,
        n_parameters).

    Raises:
        ValueError: the block lacks inputs; names all of them.
    """
    chosen = effects.corrections if candidates is None else tuple(candidates)
    yields = [c for c in effects.mechanical if isinstance(c, Compliance)]
    yields = yields if yielding is None else list(yielding)
    everything = ArmEffects(
        effects.joint_names,
        (*effects.corrections, *chosen),
        effects.bodies,
        effects.gravity_m_s2,
    )
    checked(geometry, everything, block)
    n_parameters = sum(len(correction.values) for correction in chosen)
    columns_mm = np.empty((len(block), 3, n_parameters))
    for chunk in chunks(len(block), _CHUNK_SAMPLES):
        part = block.part(chunk)
        posture = undeflected_posture(geometry, effects, part)
        amounts = totals(effects.mechanical, posture)
        arm = deflection(geometry, posture.turns_rad, amounts)
        contact = contact_seen(geometry, part, arm.rotations[:, -1])
        column = 0
        for correction in chosen:
            if isinstance(correction, FirstMoment):
                moves = _moment_moves(correction, yields, posture, arm, turns=turns)
            else:
                moves = _moves(correction, posture, arm, contact, turns=turns)
            columns_mm[chunk, :, column : column + len(moves)] = moves.transpose(
                2, 1, 0
            )
            column += len(moves)
    return columns_mm


def _moves(
    correction: Correction,
    posture: Posture,
    arm: Deflection,
    contact: Contact,
    *,
    turns: bool,
) -> Floats:
    """Differentiate for one effect, (n_parameters, 3, n_samples)."""
    if isinstance(correction, ReadingCorrection):
        amounts = correction.unit_amounts(posture.geometry, posture.block)
        by_hinges = np.moveaxis(_hinge_moves(arm, turns=turns), 1, -1)
        by_readings = np.moveaxis(arm.geometry.by_readings(by_hinges), -1, 1)
        return -_turned(amounts, by_readings[:, correction.joints])
    if isinstance(correction, BodyCorrection):
        amounts = correction.unit_amounts(posture)
        return _body_moves(correction, amounts, arm, turns=turns)
    if isinstance(correction, ContactCorrection) and not turns:
        return correction.derivatives(contact)
    # What is off-line only does not move the ball.
    return np.zeros((len(correction.values), 3, len(posture.block)))


def _moment_moves(
    correction: FirstMoment,
    yielding: Sequence[Compliance],
    posture: Posture,
    arm: Deflection,
    *,
    turns: bool,
) -> Floats:
    """Return the motion of the ball by 1 kg m along x, y and z, (3, 3, n_samples)."""
    moves = np.zeros((3, 3, len(posture.block)))
    joint = correction.joints.start
    for component in range(3):
        moments_nm = posture.moments_of(joint, component)
        for compliance in yielding:
            if compliance.joints.start <= joint:
                amounts = compliance.values[0] * compliance.yielding(
                    posture, moments_nm
                )
                ball_moves = _body_moves(compliance, amounts, arm, turns=turns)
                moves[component] += ball_moves[0]
    return moves


def _body_moves(
    correction: BodyCorrection, amounts: Floats, arm: Deflection, *, turns: bool
) -> Floats:
    joints = correction.joints
    # Components in front, as `rotate` and `cross` expect them.
    vectors = np.moveaxis(amounts, 1, 0)
    match correction.target:
        case Target.TURN:
            return _turned(amounts, _hinge_moves(arm, turns=turns)[:, joints])
        case Target.TILT:
            tilts = rotate(arm.carriers[:, joints], vectors)
            reaches_mm = arm.reaches_mm[:, joints]
            return _joint_sum(tilts if turns else cross(tilts, reaches_mm))
        case Target.MOUNT:
            reaches_mm = arm.centres_mm - arm.pivot_mm
            return amounts if turns else _parameters_first(cross(vectors, reaches_mm))
    if turns:  # the others shift only
        return np.zeros((len(amounts), *arm.centres_mm.shape))
    return _shifts(correction, amounts, vectors, arm)


def _shifts(
    correction: BodyCorrection, amounts: Floats, vectors: Floats, arm: Deflection
) -> Floats:
    joints = correction.joints
    match correction.target:
        case Target.GROWTH:
            links = rotate(arm.rotations, arm.geometry.links_mm.T[:, :, np.newaxis])
            return _joint_sum(links[:, joints][:, np.newaxis] * amounts)
        case Target.SHIFT:
            return _joint_sum(rotate(arm.carriers[:, joints], vectors))
    return amounts  # of the base


def _hinge_moves(arm: Deflection, *, turns: bool) -> Floats:
    """Return derivatives of ball or last body by the hinges, (3, n_joints, n)."""
    return arm.axes if turns else cross(arm.axes, arm.reaches_mm)


def _turned(amounts: Floats, moves_mm: Floats) -> Floats:
    """Turn joints by (n_parameters, n_chosen, n_samples)."""
    return _joint_sum(moves_mm[:, np.newaxis] * amounts)


def _joint_sum(moves: Floats) -> Floats:
    """(3, n_parameters, n_chosen, n) -> (n_parameters, 3, n)."""
    return _parameters_first(np.cumsum(moves, axis=2)[:, :, -1])


def _parameters_first(moves: Floats) -> Floats:
    return np.moveaxis(moves, 0, 1)

"""First moments of mass of an arm whose file states no masses.

Effects of gravity are compliances times moments of weights. Where nobody knows what
the elements weigh, the moments are estimated with the compliances, one distribution
for the whole arm. What the poses do not determine of it stays as an arm of usual
build has it: each first moment is expected there, with half of the mass beyond times
the element's length as its standard deviation. Only compliance times moment shows:
how heavy the whole arm is, and with it the unit of compliances, is assumed, and held.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, Effect, effect_from_table
from traverse.kinematics.effects import effect_class
from traverse.kinematics.effects.base.bodies import M_PER_MM, Bodies, bodies_from_arm
from traverse.kinematics.effects.mechanics.deformations import FirstMoment
from traverse.kinematics.model.geometry import geometry_from_arm

# Of arms and robots of a metre or two; half of it is at the joints, alike in each.
_KG_PER_MM = 0.01
_SPREAD = 0.5
# Elements count as at least so long, in mean lengths.
_SHORTEST = 0.25
# Standard deviation of the held sum, as a part of it.
_HELD = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class AssumedMoments:
    """What is expected where no mass is known.

    Attributes:
        moments_kg_m: Of each element with all beyond it, (n_joints, 3).
        stds_kg_m: Of each of the three components, (n_joints,).
        axes: Of the joints, (n_joints, 3).
        mass_kg: Of the whole arm.
    """

    moments_kg_m: Floats
    stds_kg_m: Floats
    axes: Floats
    mass_kg: float

    def expectations(self, moments: Sequence[FirstMoment]) -> Floats:
        """White equations of the components of some first moments, from where they are.

        The last one holds their sum along what is expected, each part along an axis
        counted with the element before, where it acts; of the innermost it may not act
        at all. The right side is last, (3 n + 1, 3 n + 1).
        """
        joints = [moment.joints.start for moment in moments]
        steps = self.moments_kg_m[joints] - np.array(
            [moment.values for moment in moments]
        )
        felt = self.moments_kg_m[joints].copy()
        for joint_index in reversed(range(len(joints))):
            axis = self.axes[joints[joint_index]]
            part = (felt[joint_index] @ axis) * axis
            felt[joint_index] -= part
            if joint_index:
                felt[joint_index - 1] += part
        weights = felt.copy()
        for joint_index in range(1, len(joints)):
            axis = self.axes[joints[joint_index]]
            weights[joint_index] += (weights[joint_index - 1] @ axis) * axis
        held = weights.ravel() / (_HELD * float(np.sum(felt**2)))
        stds = self.stds_of(moments)
        rows = np.vstack([np.diag(1.0 / stds), held])
        return np.column_stack([rows, rows @ steps.ravel()])

    def stds_of(self, moments: Sequence[FirstMoment]) -> Floats:
        """Standard deviations of the components of some first moments, (3 n,)."""
        return np.repeat([self.stds_kg_m[m.joints.start] for m in moments], 3)


def states_no_mass(arm: Arm) -> bool:
    """Return whether an arm file says of nothing what it weighs."""
    return not np.any(bodies_from_arm(arm).are_known)


def assumed_moments(arm: Arm) -> AssumedMoments:
    """Assume the masses of an arm of usual build, by the lengths of its elements.

    10 kg a metre, half of it along the elements and half in the joints.
    """
    geometry = geometry_from_arm(arm)
    lengths_mm = np.linalg.norm(geometry.links_mm, axis=1)
    mean_mm = float(np.mean(lengths_mm))
    masses_kg = 0.5 * _KG_PER_MM * (lengths_mm + mean_mm)
    nowhere = np.full((len(masses_kg), 3), np.nan)
    bodies = Bodies(masses_kg, nowhere, np.nan)
    carried_kg = np.cumsum(masses_kg[::-1])[::-1]
    reaches_mm = np.maximum(lengths_mm, _SHORTEST * mean_mm)
    moments_kg_m = M_PER_MM * bodies.levers_kg_mm(geometry)
    return AssumedMoments(
        moments_kg_m,
        M_PER_MM * _SPREAD * carried_kg * reaches_mm,
        geometry.axes,
        float(carried_kg[0]),
    )


def first_moments(arm: Arm) -> tuple[Effect, ...]:
    """Return the first moment of every element, as the arm states it or as assumed."""
    stated = {e.joint: e for e in arm.effects if effect_class(e.kind) is FirstMoment}
    return tuple(
        stated.get(joint.name)
        or effect_from_table(
            {
                "kind": FirstMoment.kind,
                "joint": joint.name,
                "moment_kg_m": tuple(moment_kg_m),
            }
        )
        for joint, moment_kg_m in zip(
            arm.joints, assumed_moments(arm).moments_kg_m.tolist(), strict=True
        )
    )


def own_effects(arm: Arm) -> tuple[Effect, ...]:
    """List an arm's effects but the first moments that are estimated with them."""
    if not states_no_mass(arm):
        return arm.effects
    return tuple(e for e in arm.effects if effect_class(e.kind) is not FirstMoment)


def with_first_moments(arm: Arm) -> Arm:
    """Give an arm without masses the first moments that its effects need, at the end.

    Those that the arm has are kept; without effects of gravity it has none.
    """
    if not states_no_mass(arm):
        return arm
    effects, names = own_effects(arm), [joint.name for joint in arm.joints]
    yielding = [e for e in effects if effect_class(e.kind).uses_gravity]
    if yielding:
        # Of the mount no joint is named.
        first = min(names.index(e.joint) if e.joint in names else 0 for e in yielding)
        effects = (*effects, *first_moments(arm)[first:])
    return arm.model_copy(update={"effects": effects})

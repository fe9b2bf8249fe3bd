"""All effects of an arm, ready to be applied."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects import effect_class
from traverse.kinematics.effects.base.block import Block, Covariate, Need
from traverse.kinematics.effects.base.bodies import (
    M_PER_MM,
    Bodies,
    bodies_from_arm,
)
from traverse.kinematics.effects.base.context import (
    EffectContext,
    Span,
    context_from_arm,
)
from traverse.kinematics.effects.base.correction import (
    BodyCorrection,
    ContactCorrection,
    Correction,
    ReadingCorrection,
)
from traverse.kinematics.effects.mechanics.deformations import FirstMoment
from traverse.kinematics.model.geometry import Geometry

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm, Effect


@dataclass(frozen=True, slots=True, eq=False)
class ArmEffects:
    """The effects of an arm with its masses and gravity.

    Attributes:
        joint_names: from the base outwards.
        corrections: in the order of the arm file.
        gravity_m_s2: default for blocks, (3,).
        mechanical: those that move bodies of the arm.
        contacts: those that depend on the touched surface.
        covariates: needed ones, of a joint or of the arm.
    """

    joint_names: tuple[str, ...]
    corrections: tuple[Correction, ...]
    bodies: Bodies
    gravity_m_s2: Floats
    readings: tuple[ReadingCorrection, ...] = field(init=False)
    mechanical: tuple[BodyCorrection, ...] = field(init=False)
    contacts: tuple[ContactCorrection, ...] = field(init=False)
    first_moments: tuple[FirstMoment, ...] = field(init=False)
    covariates: frozenset[Covariate] = field(init=False)

    def __post_init__(self) -> None:
        families = {
            "readings": ReadingCorrection,
            "mechanical": BodyCorrection,
            "contacts": ContactCorrection,
            "first_moments": FirstMoment,
        }
        for name, family in families.items():
            members = tuple(c for c in self.corrections if isinstance(c, family))
            object.__setattr__(self, name, members)
        covariates = frozenset(need.covariate for need in self.needs)
        object.__setattr__(self, "covariates", covariates)

    @property
    def needs(self) -> frozenset[Need]:
        return frozenset(need for c in self.corrections for need in c.needs)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """`J3.encoder_harmonic.2.cos_rad` and so on, all effects in order."""
        return tuple(
            f"{self.name(c)}.{parameter}"
            for c in self.corrections
            for parameter in c.parameters
        )

    @property
    def values(self) -> Floats:
        """Values of all parameters, (n_parameters,)."""
        return np.array([value for c in self.corrections for value in c.values])

    def name(self, correction: Correction) -> str:
        names = self.joint_names[correction.joints]
        joint = names if len(names) == 1 else ()
        return ".".join((*joint, correction.kind, *correction.variety))

    def levers_kg_mm(self, geometry: Geometry) -> Floats:
        """Contributions of the elements to the mass moment, (n_joints, 3)."""
        return _levers_kg_mm(geometry, self)

    def with_values(self, values: Floats) -> "ArmEffects":
        """Return the same effects with other values, (n_parameters,)."""
        ends = np.cumsum([len(c.values) for c in self.corrections])
        if values.shape != (int(ends[-1]) if len(ends) else 0,):
            raise ValueError(
                f"values have shape {values.shape}, expected one for each of "
                f"{', '.join(self.parameter_names) or 'no parameters'}"
            )
        parts = np.split(values, ends[:-1]) if len(ends) else []
        changed = tuple(
            c.with_values(part) for c, part in zip(self.corrections, parts, strict=True)
        )
        return replace(self, corrections=changed)

    def are_served_by(self, block: Block) -> bool:
        """Return whether a block lacks nothing; False if it must be checked in detail.

        Whole columns are checked, including joints that no effect uses.
        """
        return all(block.is_known(covariate) for covariate in self.covariates)

    def lacks(self, block: Block) -> Iterator[str]:
        """Yield, effect by effect, missing inputs of a block."""
        for correction in self.corrections:
            for need in correction.needs:
                lack = block.lack(need)
                if lack is not None:
                    of = "" if need.joint is None else self.joint_names[need.joint]
                    yield (
                        f"{self.name(correction)} needs the {need.covariate.value}"
                        f"{of and f' of {of}'}: {lack}"
                    )


def effects_from_arm(arm: "Arm") -> ArmEffects:
    return effects_of(arm, arm.effects)


def effects_of(
    arm: "Arm", effects: tuple["Effect", ...], campaign_utc: Span | None = None
) -> ArmEffects:
    """Build effects for an arm whose file does not have them (yet).

    Args:
        arm: the arm.
        effects: used instead of the arm's own.
        campaign_utc: start and end of the campaign that drifts were found in. Without
            it a drift holds from its epoch to the date of the identification;
            without that date only at its epoch, where it is zero.

    Raises:
        ValueError: effects cannot be applied to this arm; names all of them.
    """
    bodies = bodies_from_arm(arm)
    known = bodies.are_known
    for effect in effects:
        if effect_class(effect.kind) is FirstMoment:
            known |= [joint.name == effect.joint for joint in arm.joints]
    built: list[Correction] = []
    problems: list[str] = []
    for index, effect in enumerate(effects):
        setting = context_from_arm(arm, campaign_utc or _believed_utc(arm, effect))
        try:
            correction = effect_class(effect.kind).from_file(effect, setting)
        except ValueError as error:
            problems.append(f"effects[{index}]: {error}")
            continue
        built.append(correction)
        if correction.uses_gravity and not np.any(known[correction.joints.start :]):
            problems.append(f"effects[{index}]: {_no_weight(effect, setting)}")
    if problems:
        raise ValueError(f"arm {arm.name}: " + "\n".join(problems))
    return ArmEffects(
        joint_names=tuple(joint.name for joint in arm.joints),
        corrections=tuple(built),
        bodies=bodies,
        gravity_m_s2=np.array(arm.reference.gravity_m_s2),
    )


# Neither ever changes, and most calls are for the same arm.
@lru_cache(maxsize=8)
def _levers_kg_mm(geometry: Geometry, effects: ArmEffects) -> Floats:
    levers_kg_mm = effects.bodies.levers_kg_mm(geometry)
    for moment in effects.first_moments:
        levers_kg_mm[moment.joints] += np.array(moment.values) / M_PER_MM
    return levers_kg_mm


def _believed_utc(arm: "Arm", effect: "Effect") -> Span | None:
    """Span from the epoch to the identification, which follows its campaign."""
    date = None if arm.identification is None else arm.identification.date
    if isinstance(date, str):
        try:
            date = datetime.fromisoformat(date)
        except ValueError:
            return None
    if not isinstance(date, datetime) or effect.epoch_utc is None:
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=UTC)
    return effect.epoch_utc, max(date, effect.epoch_utc)


def _no_weight(effect: "Effect", setting: EffectContext) -> str:
    first = 0 if effect.joint is None else setting.joint(effect)
    return (
        f"{effect.kind} yields to weights, but the arm file has no mass_kg for "
        f"{', '.join(setting.joint_names[first:])} nor for the probe; add what they "
        "weigh, or let traverse identify or traverse diagnose estimate it"
    )

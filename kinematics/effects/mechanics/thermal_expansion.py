"""Elements that grow with the temperature.

    r_k grows by the fraction expansion_per_c (T - T_ref)

T is the joint's own temperature where it is known, else the arm's. The probe's vector
is no element: it does not grow.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import BodyCorrection, Target
from traverse.kinematics.effects.base.covariate import Covariate
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.kernel.terms import Form, Quantity, Source, Term

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalExpansion(BodyCorrection):
    """One element, or all of them alike."""

    reference_c: float

    kind: ClassVar[str] = "thermal_expansion"
    target: ClassVar[Target] = Target.GROWTH
    covariate: ClassVar[Covariate | None] = Covariate.TEMPERATURE

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        """Take the reference temperature."""
        del effect
        return {"reference_c": setting.reference_temperature_c}

    def unit_amounts(self, posture: Posture) -> Floats:
        """T - T_ref, (1, n_chosen, n_samples)."""
        temperatures_c = posture.block.temperatures_c(self.joints)
        return (temperatures_c - self.reference_c)[None]

    @property
    def terms(self) -> tuple[Term, ...]:
        """One for every element."""
        return tuple(
            Term(
                form=Form.GROWTH_RATE,
                joint=joint,
                values=self.values,
                of=Quantity(Source.TEMPERATURE, joint, self.reference_c),
            )
            for joint in self.affected
        )

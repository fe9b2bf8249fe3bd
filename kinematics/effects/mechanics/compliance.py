"""What the compliances under gravity share: one value, in rad per N m."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import BodyCorrection
from traverse.kinematics.kernel.terms import Form, Term

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Compliance(BodyCorrection):
    """Something that yields to the moments of gravity at undeflected positions."""

    uses_gravity: ClassVar[bool] = True
    form: ClassVar[Form]

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        values = (effect.values["compliance_rad_nm"],)
        return cls(joints=setting.joints(effect), values=values)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The one key of the arm file."""
        return ("compliance_rad_nm",)

    @property
    def terms(self) -> tuple[Term, ...]:
        """One; that of the mount names no joint."""
        return (Term(form=self.form, joint=self.joints.start, values=self.values),)

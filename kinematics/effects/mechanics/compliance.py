"""Base of the compliances under gravity: one value, in rad per N m."""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.correction import BodyCorrection
from traverse.kinematics.kernel.terms import Form, Term


@dataclass(frozen=True, slots=True, kw_only=True)
class Compliance(BodyCorrection):
    """Something that yields to the moments of gravity at undeflected positions."""

    uses_gravity: ClassVar[bool] = True
    form: ClassVar[Form]

    @property
    def terms(self) -> tuple[Term, ...]:
        """One; that of the mount names no joint."""
        return (Term(form=self.form, joint=self.joints.start, values=self.values),)

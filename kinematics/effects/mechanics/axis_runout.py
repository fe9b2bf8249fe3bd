"""Radial and axial error motion of an axis.

    d = P_(k-1) (cos_mm cos(order theta) + sin_mm sin(order theta))

The joint's origin shifts by d, and everything beyond with it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.mechanics.axis_motion import AxisMotion
from traverse.kinematics.kernel.terms import Form

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisRunout(AxisMotion):
    """The axis wanders."""

    kind: ClassVar[str] = "axis_runout"
    target: ClassVar[Target] = Target.SHIFT
    vectors: ClassVar[tuple[str, str]] = ("cos_mm", "sin_mm")
    form: ClassVar[Form] = Form.SHIFT_WAVE

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        values = effect.values
        return cls(
            joints=setting.joints(effect),
            values=(*values["cos_mm"], *values["sin_mm"]),
            order=values["order"],
            is_along=values["component"] == "axial",
        )

    @property
    def variety(self) -> tuple[str, ...]:
        """The component and the order."""
        return ("axial" if self.is_along else "radial", str(self.order))

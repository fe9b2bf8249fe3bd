"""Tilt error motion of an axis.

    w = P_(k-1) (cos_rad cos(order theta) + sin_rad sin(order theta))

The body carried by the joint turns additionally by w about the joint's origin.
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
class AxisWobble(AxisMotion):
    """The axis nods."""

    kind: ClassVar[str] = "axis_wobble"
    target: ClassVar[Target] = Target.TILT
    vectors: ClassVar[tuple[str, str]] = ("cos_rad", "sin_rad")
    form: ClassVar[Form] = Form.TILT_WAVE

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        values = effect.values
        return cls(
            joints=setting.joints(effect),
            values=(*values["cos_rad"], *values["sin_rad"]),
            order=values["order"],
            is_along=False,
        )

    @property
    def variety(self) -> tuple[str, ...]:
        """The order."""
        return (str(self.order),)

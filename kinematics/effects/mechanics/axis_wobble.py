"""Tilt error motion of an axis.

    w = P_(k-1) (cos_rad cos(order theta) + sin_rad sin(order theta))

The body carried by the joint turns additionally by w about the joint's origin.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.mechanics.axis_motion import AxisMotion
from traverse.kinematics.kernel.terms import Form


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisWobble(AxisMotion):
    """The axis nods."""

    kind: ClassVar[str] = "axis_wobble"
    target: ClassVar[Target] = Target.TILT
    form: ClassVar[Form] = Form.TILT_WAVE

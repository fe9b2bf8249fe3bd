"""Radial and axial error motion of an axis.

    d = P_(k-1) (cos_mm cos(order theta) + sin_mm sin(order theta))

The joint's origin shifts by d, and everything beyond with it.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.mechanics.axis_motion import AxisMotion
from traverse.kinematics.kernel.terms import Form


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisRunout(AxisMotion):
    """The axis wanders."""

    kind: ClassVar[str] = "axis_runout"
    target: ClassVar[Target] = Target.SHIFT
    form: ClassVar[Form] = Form.SHIFT_WAVE

"""A stand, a table or a magnet that gives way under the arm.

    w = compliance_rad_nm M_1, the moment of all weights about origin_mm

Everything turns by w about `origin_mm`. The moment of weights is a cross product with
gravity: it has no part along it, and all of it counts as across.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

from traverse.arrays import Floats
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.effects.mechanics.compliance import Compliance
from traverse.kinematics.kernel.terms import Form

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True, kw_only=True)
class MountCompliance(Compliance):
    """The base gives way as a whole."""

    kind: ClassVar[str] = "mount_compliance"
    target: ClassVar[Target] = Target.MOUNT
    form: ClassVar[Form] = Form.MOUNT_MOMENT

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Build it from an entry of `[[effects]]`."""
        del setting
        return cls(joints=slice(0, 0), values=(effect.values["compliance_rad_nm"],))

    def unit_amounts(self, posture: Posture) -> Floats:
        """The overturning moment in N m, (1, 3, n_samples)."""
        return posture.moments_nm[None, :, 0]

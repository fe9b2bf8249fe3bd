"""A stand, a table or a magnet that yields under the arm.

    w = compliance_rad_nm M_1, the moment of all weights about origin_mm

Everything turns by w about `origin_mm`. The moment of weights is a cross product with
gravity: it has no part along it, and all of it counts as across.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.effects.mechanics.compliance import Compliance
from traverse.kinematics.kernel.terms import Form


@dataclass(frozen=True, slots=True, kw_only=True)
class MountCompliance(Compliance):
    """Elastic motion of the whole base."""

    kind: ClassVar[str] = "mount_compliance"
    target: ClassVar[Target] = Target.MOUNT
    form: ClassVar[Form] = Form.MOUNT_MOMENT

    def unit_amounts(self, posture: Posture) -> Floats:
        """The overturning moment in N m, (1, 3, n_samples)."""
        return posture.moments_nm[None, :, 0]

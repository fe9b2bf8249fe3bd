"""A bearing that tilts, or a link that bends at its root.

    w = compliance_rad_nm (M_k - a_k (a_k . M_k))

The body carried by the joint turns by w about the joint's origin.
"""

from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.bodies import dot
from traverse.kinematics.effects.base.correction import Target
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.effects.mechanics.compliance import Compliance
from traverse.kinematics.kernel.terms import Form


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingCompliance(Compliance):
    """Elastic tilt of the joint across its axis."""

    kind: ClassVar[str] = "bearing_compliance"
    target: ClassVar[Target] = Target.TILT
    form: ClassVar[Form] = Form.TILT_MOMENT

    def unit_amounts(self, posture: Posture) -> Floats:
        """The moment across the axis in N m, (1, 3, 1, n_samples)."""
        joint = self.joints.start
        axis, moment_nm = posture.axes[:, joint], posture.moments_nm[:, joint]
        across_nm = moment_nm - axis * dot(axis, moment_nm)
        return posture.in_carrier(across_nm, joint)[None, :, None]

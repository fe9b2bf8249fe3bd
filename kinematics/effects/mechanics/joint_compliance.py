"""Torsion between a joint's encoder and what the joint carries.

    theta_k grows by compliance_rad_nm (a_k . M_k)

a_k the axis, M_k the moment about the joint's origin of all weights beyond it.
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
class JointCompliance(Compliance):
    """Elastic turn of the joint about its axis."""

    kind: ClassVar[str] = "joint_compliance"
    target: ClassVar[Target] = Target.TURN
    form: ClassVar[Form] = Form.TURN_MOMENT

    def unit_amounts(self, posture: Posture) -> Floats:
        """The torque about the axis in N m, (1, 1, n_samples)."""
        axes, moments_nm = posture.axes, posture.moments_nm
        return dot(axes[:, self.joints], moments_nm[:, self.joints])[None]

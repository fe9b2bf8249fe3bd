"""Bodies that yield to gravity, in rad per N m, or grow with the temperature.

M_k is the moment about the joint's origin of all weights beyond it, a_k the axis.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Covariate
from traverse.kinematics.effects.base.correction import (
    BodyCorrection,
    Correction,
    Target,
)
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.kernel.terms import Form, Quantity, Source, Term
from traverse.kinematics.model.quaternion import dot


@dataclass(frozen=True, slots=True, kw_only=True)
class Compliance(BodyCorrection):
    """Deflection by the moments of gravity at undeflected positions."""

    uses_gravity: ClassVar[bool] = True
    form: ClassVar[Form]

    @abstractmethod
    def yielding(self, posture: Posture, moments_nm: Floats) -> Floats:
        """Return deflections by moments (3, n_joints, n_samples) at 1 rad/Nm."""

    def unit_amounts(self, posture: Posture) -> Floats:
        return self.yielding(posture, posture.moments_nm)

    @property
    def terms(self) -> tuple[Term, ...]:
        return (Term(form=self.form, joint=self.joints.start, values=self.values),)


@dataclass(frozen=True, slots=True, kw_only=True)
class JointCompliance(Compliance):
    """Torsion between a joint's encoder and the link that it carries.

    theta_k grows by compliance_rad_nm (a_k . M_k)
    """

    kind: ClassVar[str] = "joint_compliance"
    target: ClassVar[Target] = Target.TURN
    form: ClassVar[Form] = Form.TURN_MOMENT

    def yielding(self, posture: Posture, moments_nm: Floats) -> Floats:
        """Return the torque about the axis in N m, (1, 1, n_samples)."""
        return dot(posture.axes[:, self.joints], moments_nm[:, self.joints])[None]


@dataclass(frozen=True, slots=True, kw_only=True)
class BearingCompliance(Compliance):
    """A bearing that tilts, or a link that bends at its root.

    The body carried by the joint turns about the joint's origin by
    w = compliance_rad_nm (M_k - a_k (a_k . M_k)).
    """

    kind: ClassVar[str] = "bearing_compliance"
    target: ClassVar[Target] = Target.TILT
    form: ClassVar[Form] = Form.TILT_MOMENT

    def yielding(self, posture: Posture, moments_nm: Floats) -> Floats:
        """Return the moment across the axis in N m, (1, 3, 1, n_samples)."""
        joint = self.joints.start
        axis, moment_nm = posture.axes[:, joint], moments_nm[:, joint]
        across_nm = moment_nm - axis * dot(axis, moment_nm)
        return posture.in_carrier(across_nm, joint)[None, :, None]


@dataclass(frozen=True, slots=True, kw_only=True)
class MountCompliance(Compliance):
    """A stand, a table or a magnet that yields: all turns by w about `origin_mm`.

    w = compliance_rad_nm M_1. The moment of weights is a cross product with gravity: it
    has no part along it, and all of it counts as across.
    """

    kind: ClassVar[str] = "mount_compliance"
    target: ClassVar[Target] = Target.MOUNT
    form: ClassVar[Form] = Form.MOUNT_MOMENT

    def yielding(self, posture: Posture, moments_nm: Floats) -> Floats:
        """Return the overturning moment in N m, (1, 3, n_samples)."""
        del posture
        return moments_nm[None, :, 0]


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstMoment(Correction):
    """Addition of an element and its load to the arm's first moment of mass.

    moment_kg_m = m c + M r of the element's own mass m at c from the joint's origin and
    the mass M of everything beyond, which hangs at the end of the link r; beside what
    the arm file's masses say. It moves nothing but what yields to gravity: M_k gains

        sum over j from k outwards of (P_j moment_kg_m_j) x g

    P_j turns a part along the axis u_j as P_(j-1) does, so that it counts for element
    j - 1 as well; and compliances times moments are all that poses can show.
    """

    kind: ClassVar[str] = "first_moment"


@dataclass(frozen=True, slots=True, kw_only=True)
class ThermalExpansion(BodyCorrection):
    """One element, or all of them alike: r_k grows by expansion_per_c (T - T_ref).

    T is the joint's own temperature where it is known, else the arm's. The probe's
    vector is no element: it does not grow.
    """

    reference_temperature_c: float

    kind: ClassVar[str] = "thermal_expansion"
    target: ClassVar[Target] = Target.GROWTH
    covariate: ClassVar[Covariate | None] = Covariate.TEMPERATURE

    def unit_amounts(self, posture: Posture) -> Floats:
        """T - T_ref, (1, n_chosen, n_samples)."""
        temperatures_c = posture.block.temperatures_c(self.joints)
        return (temperatures_c - self.reference_temperature_c)[None]

    @property
    def terms(self) -> tuple[Term, ...]:
        return tuple(
            Term(
                form=Form.GROWTH_RATE,
                joint=joint,
                values=self.values,
                of=Quantity(Source.TEMPERATURE, joint, self.reference_temperature_c),
            )
            for joint in self.affected
        )

"""Motions that weights do not cause: of an axis with its joint, of the base in time.

An error motion of an axis is a vector that goes round with the turn of the joint:

    cos (3) cos(order theta) + sin (3) sin(order theta), turned by P_(k-1)
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.correction import BodyCorrection, Target
from traverse.kinematics.effects.base.epochs import (
    DriftTime,
    EffectTime,
    StepTime,
    TimedCorrection,
)
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.kernel.terms import Form, Term
from traverse.kinematics.model.geometry import Geometry, across


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMotion(BodyCorrection):
    """Six values: three of the cosine, three of the sine."""

    order: int

    form: ClassVar[Form]

    def free_directions(self, geometry: Geometry) -> Floats:
        """Across the axis, (6, 4), or along it, (6, 2)."""
        axis = geometry.axes[self.joints.start]
        if "axial" in self.variety:
            directions = axis[:, np.newaxis]
        else:
            first, second = across(axis)
            directions = np.stack([first, second], axis=1)
        return np.kron(np.eye(2), directions)

    def unit_amounts(self, posture: Posture) -> Floats:
        """Waves in each component, (6, 3, 1, n_samples)."""
        cosine, sine = self._waves(posture)
        amounts = np.zeros((6, 3, 1, len(cosine)))
        for component in range(3):
            amounts[component, component, 0] = cosine
            amounts[3 + component, component, 0] = sine
        return amounts

    def amount(self, posture: Posture) -> Floats:
        """The same without the zeros between, (3, 1, n_samples)."""
        cosine, sine = self._waves(posture)
        vectors = np.array(self.values).reshape(2, 3, 1, 1)
        total: Floats = vectors[0] * cosine + vectors[1] * sine
        return total

    @property
    def terms(self) -> tuple[Term, ...]:
        joint = self.joints.start
        return (
            Term(form=self.form, joint=joint, order=self.order, values=self.values),
        )

    def _waves(self, posture: Posture) -> tuple[Floats, Floats]:
        phases_rad = self.order * posture.turns_rad[self.joints.start]
        return np.cos(phases_rad), np.sin(phases_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisRunout(AxisMotion):
    """Radial or axial: the joint's origin shifts by it, and everything beyond."""

    kind: ClassVar[str] = "axis_runout"
    target: ClassVar[Target] = Target.SHIFT
    form: ClassVar[Form] = Form.SHIFT_WAVE


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisWobble(AxisMotion):
    """Tilt: the body carried by the joint turns by it about the joint's origin."""

    kind: ClassVar[str] = "axis_wobble"
    target: ClassVar[Target] = Target.TILT
    form: ClassVar[Form] = Form.TILT_WAVE


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseMotion(TimedCorrection, BodyCorrection):
    """x_0 moves by a vector times something of time."""

    target: ClassVar[Target] = Target.BASE

    def unit_amounts(self, posture: Posture) -> Floats:
        """Factor of the time, in each component, (3, 3, n_samples)."""
        return np.eye(3)[:, :, np.newaxis] * self.time.amounts(posture.block)

    def amount(self, posture: Posture) -> Floats:
        return np.array(self.values)[:, np.newaxis] * self.time.amounts(posture.block)

    @property
    def terms(self) -> tuple[Term, ...]:
        of = self.time.quantity
        return (Term(form=Form.BASE_RATE, values=self.values, of=of),)


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseDrift(BaseMotion):
    """A base that creeps: x_0 moves by rate_mm_s (t - epoch).

    Outside the campaign it keeps the place of the campaign's nearer end, and the sample
    is flagged `stale_effect`.
    """

    kind: ClassVar[str] = "base_drift"
    clock: ClassVar[type[EffectTime]] = DriftTime


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseStep(BaseMotion):
    """A knocked mount: x_0 jumps by step_mm at epoch + at_s and stays there.

    The moment is not a parameter: nothing can be differentiated for it. It is scanned.
    The mount may be knocked again.
    """

    kind: ClassVar[str] = "base_step"
    clock: ClassVar[type[EffectTime]] = StepTime

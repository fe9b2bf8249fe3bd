"""Motions of x_0 in time: three values, the components of a vector."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseMotion(TimedCorrection, BodyCorrection):
    """x_0 moves by a vector times something of time."""

    target: ClassVar[Target] = Target.BASE

    def unit_amounts(self, posture: Posture) -> Floats:
        """Factor of the time, in each component, (3, 3, n_samples)."""
        return np.eye(3)[:, :, np.newaxis] * self.time.amounts(posture.block)

    def amount(self, posture: Posture) -> Floats:
        """The same without the zeros between, (3, n_samples)."""
        return np.array(self.values)[:, np.newaxis] * self.time.amounts(posture.block)

    @property
    def terms(self) -> tuple[Term, ...]:
        """One vector."""
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

"""Motions of x_0 in time: three values, the components of a vector."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.correction import BodyCorrection, Target
from traverse.kinematics.effects.base.covariate import Covariate, Need
from traverse.kinematics.effects.base.epochs import DriftTime, StepTime
from traverse.kinematics.effects.base.posture import Posture
from traverse.kinematics.kernel.terms import Form, Term


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseMotion(BodyCorrection):
    """x_0 moves by a vector times something of time."""

    time: DriftTime | StepTime

    target: ClassVar[Target] = Target.BASE
    key: ClassVar[str]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Components of the key of the arm file."""
        return tuple(f"{self.key}.{xyz}" for xyz in "xyz")

    @property
    def needs(self) -> tuple[Need, ...]:
        """The time."""
        return (Need(Covariate.UTC),)

    @abstractmethod
    def course(self, block: Block) -> Floats:
        """What the vector is multiplied by, (n_samples,)."""

    def unit_amounts(self, posture: Posture) -> Floats:
        """The course in each component, (3, 3, n_samples)."""
        return np.eye(3)[:, :, np.newaxis] * self.course(posture.block)

    def amount(self, posture: Posture) -> Floats:
        """The same without the zeros between, (3, n_samples)."""
        return np.array(self.values)[:, np.newaxis] * self.course(posture.block)

    @property
    def terms(self) -> tuple[Term, ...]:
        """One vector."""
        of = self.time.quantity
        return (Term(form=Form.BASE_RATE, values=self.values, of=of),)

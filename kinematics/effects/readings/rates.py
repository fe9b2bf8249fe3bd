"""Reading corrections of one parameter: d_alpha is its product with a regressor."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effects.base.block import Block, Covariate
from traverse.kinematics.effects.base.correction import ReadingCorrection
from traverse.kinematics.effects.base.epochs import (
    DriftTime,
    EffectTime,
    StepTime,
    TimedCorrection,
)
from traverse.kinematics.kernel.terms import Form, Quantity, Source, Term
from traverse.kinematics.model.geometry import Geometry


@dataclass(frozen=True, slots=True, kw_only=True)
class SingleRate(ReadingCorrection):
    """One value, the same for all its joints."""

    per_value: ClassVar[float] = 1.0  # unit amount over quantity

    @abstractmethod
    def quantity(self, joint: int) -> Quantity:
        """Return the factor of a joint's value, besides `per_value`."""

    @property
    def terms(self) -> tuple[Term, ...]:
        values = (self.per_value * self.values[0],)
        form = Form.READING_RATE
        return tuple(
            Term(form=form, joint=joint, values=values, of=self.quantity(joint))
            for joint in self.affected
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderScale(SingleRate):
    """A graduation that is too long or too short, as of a tape, a belt or a gear.

    d_alpha = 1e-6 scale_ppm (alpha - zero)
    """

    kind: ClassVar[str] = "encoder_scale"
    per_value: ClassVar[float] = 1e-6

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """A millionth of the turn since the base posture, (1, 1, n_samples) rad/ppm."""
        zeros_rad = geometry.zeros_rad[self.joints, np.newaxis]
        turns_rad = block.rows("angles_rad", self.joints) - zeros_rad
        return 1e-6 * turns_rad[np.newaxis]

    def quantity(self, joint: int) -> Quantity:
        """The turn since the base posture."""
        return Quantity(Source.TURN, joint)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderLatency(SingleRate):
    """Readings that are older than stated: d_alpha = -latency_s d(alpha)/dt.

    Without a joint it is the same for all of them: a clock, not a filter.
    """

    kind: ClassVar[str] = "encoder_latency"
    covariate: ClassVar[Covariate | None] = Covariate.SPEED
    per_value: ClassVar[float] = -1.0

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """-d(alpha)/dt, (1, n_chosen, n_samples) rad/s."""
        del geometry
        return -block.rows("speeds_rad_s", self.joints)[np.newaxis]

    def quantity(self, joint: int) -> Quantity:
        """d(alpha)/dt."""
        return Quantity(Source.SPEED, joint)


@dataclass(frozen=True, slots=True, kw_only=True)
class Backlash(SingleRate):
    """Play between the joint and its encoder: two-valued by the direction of approach.

    d_alpha = half_width_rad sign(direction of approach); without an approach, 0,
    nothing is corrected.
    """

    kind: ClassVar[str] = "backlash"
    covariate: ClassVar[Covariate | None] = Covariate.APPROACH

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """-1, 0 or +1, (1, 1, n_samples)."""
        del geometry
        return np.sign(block.rows("approaches", self.joints))[np.newaxis]

    def quantity(self, joint: int) -> Quantity:
        """-1, 0 or +1."""
        return Quantity(Source.SENSE, joint)


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderTemperature(SingleRate):
    """A reading that follows the temperature: d_alpha = rate_rad_c (T - T_ref).

    T is the joint's own temperature where it is known, else the arm's.
    """

    reference_temperature_c: float

    kind: ClassVar[str] = "encoder_temperature"
    covariate: ClassVar[Covariate | None] = Covariate.TEMPERATURE

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """T - T_ref, (1, 1, n_samples)."""
        del geometry
        return (block.temperatures_c(self.joints) - self.reference_temperature_c)[
            np.newaxis
        ]

    def quantity(self, joint: int) -> Quantity:
        """T - T_ref."""
        return Quantity(Source.TEMPERATURE, joint, self.reference_temperature_c)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedReading(TimedCorrection, SingleRate):
    """One reading that changes with time alone."""

    def unit_amounts(self, geometry: Geometry, block: Block) -> Floats:
        """Factor of the time, (1, 1, n_samples)."""
        del geometry
        return self.time.amounts(block)[np.newaxis, np.newaxis]

    def quantity(self, joint: int) -> Quantity:
        del joint
        return self.time.quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class EncoderDrift(TimedReading):
    """A reading that drifts with time: d_alpha = rate_rad_s (t - epoch).

    Outside the campaign it keeps the value of the campaign's nearer end, and the sample
    is flagged `stale_effect`.
    """

    kind: ClassVar[str] = "encoder_drift"
    clock: ClassVar[type[EffectTime]] = DriftTime


@dataclass(frozen=True, slots=True, kw_only=True)
class CountSlip(TimedReading):
    """Counts lost, or a new reference: d_alpha = step_rad for t >= epoch + at_s.

    The moment is not a parameter: nothing can be differentiated for it. It is scanned.
    A joint may slip again.
    """

    kind: ClassVar[str] = "count_slip"
    clock: ClassVar[type[EffectTime]] = StepTime

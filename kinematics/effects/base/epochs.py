"""Times of effects, exact in nanoseconds until the last step."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.effects.base.block import Block, Covariate
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.effects.base.correction import Correction, FlagName
from traverse.kinematics.kernel.terms import Quantity, Source

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True)
class DriftTime:
    """Seconds since the epoch, held outside the campaign that the drift was found in.

    Attributes:
        epoch_ns: zero of the drift, UTC since 1970.
    """

    epoch_ns: int
    start_ns: int
    end_ns: int

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        start_ns, end_ns = setting.span_ns(effect)
        return cls(setting.epoch_ns(effect), start_ns, end_ns)

    def amounts(self, block: Block) -> Floats:
        """Seconds since the epoch, at most those of the campaign, (n_samples,)."""
        held_ns = np.minimum(np.maximum(_utc_ns(block), self.start_ns), self.end_ns)
        since_s: Floats = (held_ns - self.epoch_ns) * np.float64(1e-9)
        return since_s

    @property
    def quantity(self) -> Quantity:
        span_ns = (self.epoch_ns, self.start_ns, self.end_ns)
        return Quantity(Source.DRIFT, span_ns=span_ns)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        times_ns = _utc_ns(block)
        yield "stale_effect", (times_ns < self.start_ns) | (times_ns > self.end_ns)


@dataclass(frozen=True, slots=True)
class StepTime:
    """1 from the moment of a step on; 0 before.

    Attributes:
        epoch_ns: origin of at_s, UTC since 1970.
    """

    epoch_ns: int
    at_s: float

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        return cls(setting.epoch_ns(effect), effect.values["at_s"])

    def amounts(self, block: Block) -> Floats:
        """0 or 1, (n_samples,)."""
        since_s = (_utc_ns(block) - self.epoch_ns) * 1e-9
        return np.where(since_s >= self.at_s, 1.0, 0.0)

    @property
    def quantity(self) -> Quantity:
        span_ns = (self.epoch_ns, 0, 0)
        return Quantity(Source.STEP, reference=self.at_s, span_ns=span_ns)

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        yield from ()


EffectTime = DriftTime | StepTime
"""Factor of an effect as a function of time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedCorrection(Correction):
    """An effect that is a function of time alone."""

    time: EffectTime

    covariate: ClassVar[Covariate | None] = Covariate.UTC
    clock: ClassVar[type[EffectTime]]

    @classmethod
    def surroundings(cls, effect: "Effect", setting: EffectContext) -> dict[str, Any]:
        return {"time": cls.clock.from_file(effect, setting)}

    def flags(self, block: Block) -> Iterator[tuple[FlagName, Booleans]]:
        return self.time.flags(block)


def _utc_ns(block: Block) -> Integers:
    if block.utc_ns is None:
        raise ValueError("block: utc_ns is absent, expected one value a sample")
    return block.utc_ns

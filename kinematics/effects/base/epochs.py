"""Times that effects are bound to, exactly in nanoseconds until the last step."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import EffectContext
from traverse.kinematics.kernel.terms import Quantity, Source

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Effect


@dataclass(frozen=True, slots=True)
class DriftTime:
    """The time of a drift, held outside the campaign that the drift was found in.

    Attributes:
        epoch_ns: Where the drift is zero, UTC since 1970.
        start_ns: Of the campaign, likewise.
        end_ns: Of the campaign, likewise.
    """

    epoch_ns: int
    start_ns: int
    end_ns: int

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Take it from an entry of `[[effects]]` and the campaign's span."""
        start_ns, end_ns = setting.span_ns(effect)
        return cls(setting.epoch_ns(effect), start_ns, end_ns)

    def since_epoch_s(self, block: Block) -> Floats:
        """Seconds since the epoch, at most those of the campaign, (n_samples,)."""
        held_ns = np.minimum(np.maximum(_utc_ns(block), self.start_ns), self.end_ns)
        since_s: Floats = (held_ns - self.epoch_ns) * np.float64(1e-9)
        return since_s

    @property
    def quantity(self) -> Quantity:
        """Those seconds, for the kernel in C."""
        span_ns = (self.epoch_ns, self.start_ns, self.end_ns)
        return Quantity(Source.DRIFT, span_ns=span_ns)

    def is_stale(self, block: Block) -> Booleans:
        """Which samples are outside the campaign, (n_samples,)."""
        times_ns = _utc_ns(block)
        return (times_ns < self.start_ns) | (times_ns > self.end_ns)


@dataclass(frozen=True, slots=True)
class StepTime:
    """The moment of a step, which lasts.

    Attributes:
        epoch_ns: From where at_s counts, UTC since 1970.
        at_s: When it happened.
    """

    epoch_ns: int
    at_s: float

    @classmethod
    def from_file(cls, effect: "Effect", setting: EffectContext) -> Self:
        """Take it from an entry of `[[effects]]`."""
        return cls(setting.epoch_ns(effect), effect.values["at_s"])

    def has_occurred(self, block: Block) -> Floats:
        """1 from the moment on, 0 before, (n_samples,)."""
        since_s = (_utc_ns(block) - self.epoch_ns) * 1e-9
        return np.where(since_s >= self.at_s, 1.0, 0.0)

    @property
    def quantity(self) -> Quantity:
        """That 0 or 1, for the kernel in C."""
        span_ns = (self.epoch_ns, 0, 0)
        return Quantity(Source.STEP, reference=self.at_s, span_ns=span_ns)


def _utc_ns(block: Block) -> Integers:
    if block.utc_ns is None:
        raise ValueError("block: utc_ns is absent, expected one value a sample")
    return block.utc_ns

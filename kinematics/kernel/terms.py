"""Effects as the kernel in C takes them: sums of terms, each an amount of something.

The laws are those of `traverse.kinematics.effects`, which remain the readable
definition and compute where no kernel does; `effects.h` has the formulas and the same
numbers.
"""

from dataclasses import dataclass
from enum import IntEnum


class Form(IntEnum):
    """Target of a term, and how it is computed."""

    READING_WAVE = 0
    READING_RATE = 1
    READING_SPLINE = 2
    TURN_MOMENT = 3
    TILT_MOMENT = 4
    MOUNT_MOMENT = 5
    TILT_WAVE = 6
    SHIFT_WAVE = 7
    GROWTH_RATE = 8
    BASE_RATE = 9


class Source(IntEnum):
    """Kinds of quantities that a sample has."""

    READING = 0
    TURN = 1
    SPEED = 2
    APPROACH = 3
    SENSE = 4
    TEMPERATURE = 5
    DRIFT = 6
    STEP = 7
    CAMPAIGN = 8
    FORCE = 9


@dataclass(frozen=True, slots=True)
class Quantity:
    """Quantity that multiplies the rate of a term, or enters its spline.

    Attributes:
        joint: counted from 0; None: of the arm as a whole.
        reference: subtracted from a temperature; of a step its seconds.
        span_ns: epoch, start and end of the campaign in UTC since 1970.
    """

    source: Source
    joint: int | None = None
    reference: float = 0.0
    span_ns: tuple[int, int, int] = (0, 0, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One summand.

    Attributes:
        values: 1 to 6, by the form.
        joint: that moves, counted from 0; any for the arm as a whole.
        order: periods a turn, of a wave.
        of: of a rate or a spline.
        spline: knots, steps (with one more number), values and second derivatives at
            the knots, concatenated.
    """

    form: Form
    values: tuple[float, ...] = ()
    joint: int = 0
    order: float = 0
    of: Quantity | None = None
    spline: tuple[float, ...] = ()

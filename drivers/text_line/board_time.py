"""What the time in a board's lines looks like where it is not as configured.

A sketch may print microseconds where milliseconds are expected, or a counter of 16
bits. Both look like clocks that jump; the sizes of the jumps tell what they are.
"""

from collections.abc import Sequence
from statistics import median

from traverse.drivers.base.values import DeviceError

UNITS_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
UNIT_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds"}
# Clocks of boards are off by some percent at most.
LEAST_RATIO, MOST_RATIO = 0.5, 2.0
UNIT_RATIO = 1.4  # so near to that of another unit it is this one
LEAST_READS, LEAST_SPAN_NS = 8, 300_000_000
LEAST_WRAP_S = 5.0  # after a shorter interruption no time may be ambiguous
WRAPS_S = (
    *(2.0**bits * 1e-6 for bits in (24, 31, 32)),
    *(2.0**bits * 1e-3 for bits in (16, 24, 31, 32)),
    *(60.0, 3600.0, 86_400.0),
    *(10.0**digits for digits in range(1, 7)),
)
"""After these a board's time may begin anew: counters of micros() and millis() that
were cut to a type of so many bits, the time of day, a number of digits."""
WRAP_SLACK_S = 0.05  # that two lines arrive later or earlier than their times


def check_advance(
    readings: Sequence[tuple[int, int]], port: str, time_unit: str, tick_ns: float
) -> None:
    """Check that the times of lines advance about as fast as the computer's clock.

    Args:
        readings: the ticks and the arrival [ns] of successive lines.
        port: of the board, for people.
        time_unit: as configured.
        tick_ns: length of a tick.

    Raises:
        DeviceError: they do not, with the unit that they seem to have.
    """
    ratio = _advance(readings, tick_ns)
    if ratio is None or LEAST_RATIO < ratio < MOST_RATIO:
        return
    if ratio <= 0.0:
        raise DeviceError(
            f"the time of the lines on {port} does not advance",
            "have the board print its millis(), or put {skip} in the place of {time} "
            "in the pattern",
        )
    text = (
        f"the time of the lines on {port} advances {_rounded(ratio)} times as fast as "
        f"the computer's clock, if it is in {UNIT_NAMES[time_unit]} as time_unit says"
    )
    for name, unit_s in UNITS_S.items():
        share = ratio * unit_s / UNITS_S[time_unit]
        if name != time_unit and 1.0 / UNIT_RATIO < share < UNIT_RATIO:
            raise DeviceError(
                f"{text}: it looks like {UNIT_NAMES[name]}",
                f'set time_unit = "{name}" for this device',
            )
    raise DeviceError(
        text,
        "have the board print seconds, milliseconds or microseconds and set time_unit, "
        "or put {skip} in the place of {time} in the pattern",
    )


def _rounded(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):g}"


def _advance(readings: Sequence[tuple[int, int]], tick_ns: float) -> float | None:
    """Return how fast times advance beside the computer's clock; None if unknown.

    Of lines that were read together the last one had just arrived. The first ones may
    have waited for the port to be opened, others for a busy computer, and a counter may
    wrap between two: the median of pairs a quarter of the lines apart bears all that.
    """
    last_of_read = {arrived_ns: ticks for ticks, arrived_ns in readings}
    reads = [*last_of_read.items()][1:]
    if len(reads) < LEAST_READS or reads[-1][0] - reads[0][0] < LEAST_SPAN_NS:
        return None
    apart = len(reads) // 4
    return median(
        (later - ticks) * tick_ns / (later_ns - arrived_ns)
        for (arrived_ns, ticks), (later_ns, later) in zip(
            reads, reads[apart:], strict=False
        )
    )


def wrap_of(back_s: float, time_unit: str) -> tuple[str, str] | None:
    """Return what a time that went back by so much looks like, and the remedy.

    None: it looks like a board that was reset.
    """
    for wrap_s in WRAPS_S:
        if abs(back_s - wrap_s) < WRAP_SLACK_S and wrap_s >= LEAST_WRAP_S:
            in_units = f"{wrap_s / UNITS_S[time_unit]:.6f}".rstrip("0").rstrip(".")
            return (
                f"its time went back by {wrap_s:g} s; does it wrap there?",
                f"if it does, set time_wrap = {in_units} for this device; if not, the "
                "board was reset: check its supply and cable",
            )
    return None

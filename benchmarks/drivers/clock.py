"""`python -m benchmarks.drivers.clock`: error of a device's clock tied to ours.

A device latches 100 times a second by a clock that is some ppm off; every latch reaches
the host after a varying delay. Printed is the error of the mapped time. The smallest
delay is indistinguishable from an offset: it is 0.1 ms here and subtracted. Virtual
time, seeded.
"""

from collections.abc import Callable

import numpy as np

from benchmarks.tools.command_line import run_main
from traverse.arrays import Floats
from traverse.drivers.timing.device_clock import WRAP, DeviceClock

RATE_HZ = 100.0
SECONDS = 60.0
SETTLED_S = 10.0
TICK_RATE_HZ = 1_000_000
LEAST_NS = 100_000
BLOCK = 2  # samples per read

Delays = Callable[[np.random.Generator, int], Floats]


def even(most_ms: float) -> Delays:
    return lambda rng, n: rng.uniform(0.0, most_ms * 1e6, n)


def tailed(mean_ms: float) -> Delays:
    return lambda rng, n: rng.exponential(mean_ms * 1e6, n)


def stalled(most_ms: float, stall_ms: float) -> Delays:
    """Return delays as `even`, with a long stall for a second in ten."""

    def delays(rng: np.random.Generator, n: int) -> Floats:
        drawn = rng.uniform(0.0, most_ms * 1e6, n)
        busy = np.arange(n) % int(10 * RATE_HZ) < RATE_HZ
        return np.asarray(drawn + busy * rng.uniform(0.0, stall_ms * 1e6, n))

    return delays


CASES: dict[str, Delays] = {
    "0.1 ms": even(0.1),
    "0.5 ms": even(0.5),
    "1 ms": even(1.0),
    "5 ms": even(5.0),
    "exponential, mean 1 ms": tailed(1.0),
    "1 ms, stalls of 20 ms": stalled(1.0, 20.0),
}


def errors_ns(ppm: float, delays: Delays, seed: int = 1) -> Floats:
    """Return the error of each latch's time, as it arrives, (n,)."""
    rng = np.random.default_rng(seed)
    clock = DeviceClock(TICK_RATE_HZ)
    n = int(RATE_HZ * SECONDS)
    latch_ns = 1e12 + np.arange(n) * 1e9 / RATE_HZ
    first = WRAP - int(20.0 * TICK_RATE_HZ)  # it wraps after 20 s
    elapsed_s = (latch_ns - 1e12) * 1e-9
    ticks = first + np.floor(elapsed_s * TICK_RATE_HZ * (1 + ppm * 1e-6))
    shown = (ticks.astype(np.int64) % WRAP).astype(np.uint32)
    arrived_ns = latch_ns + LEAST_NS + delays(rng, n)
    arrived_ns = np.maximum.accumulate(arrived_ns)
    errors = np.zeros(n)
    for start in range(0, n, BLOCK):
        rows = slice(start, start + BLOCK)
        unwrapped = clock.unwrap(shown[rows])
        clock.update(int(unwrapped[-1]), int(arrived_ns[rows][-1]))
        errors[rows] = clock.to_ns_array(unwrapped) - latch_ns[rows] - LEAST_NS
    return errors


def main() -> None:
    print(f"error of the mapped time in microseconds, {SECONDS:g} s at {RATE_HZ:g} Hz")
    print(f"{'jitter':24} {'ppm':>5} {'first s':>9} | after {SETTLED_S:g} s: bias")
    print(f"{'':24} {'':>5} {'largest':>9} | {'median':>9} {'95 %':>9} {'largest':>9}")
    for name, delays in CASES.items():
        for ppm in (10.0, 200.0):
            off_us = errors_ns(ppm, delays) * 1e-3
            settled = off_us[int(SETTLED_S * RATE_HZ) :]
            spread = np.abs(settled - np.median(settled))
            print(
                f"{name:24} {ppm:5g} {np.abs(off_us[: int(RATE_HZ)]).max():9.0f} | "
                f"{np.median(settled):9.1f} {np.percentile(spread, 95):9.1f} "
                f"{np.abs(settled).max():9.1f}"
            )


if __name__ == "__main__":
    run_main(main)

"""Run devices in real time, or as fast as the host reads."""

import select
import time
from collections.abc import Callable, Sequence
from typing import Protocol

from traverse.simulator.devices.device import SimulatedDevice
from traverse.simulator.scenario.wiring import ScriptClock

BLOCK_S = 0.002  # samples of so long are computed and sent together
IDLE_S = 0.020  # at least so often everything is looked at
FAST_STEP_S = 0.020
LINGER_S = 0.5  # at the end of a script: the last edges get their acknowledgement
PATIENCE_S = 0.5  # and so long it waits


class Clock(Protocol):
    """Monotonic seconds from an arbitrary origin."""

    def now_s(self) -> float:
        """The time."""


class MonotonicClock:
    """The host's monotonic clock, from 0 at its making."""

    def __init__(self) -> None:
        self.origin_ns = time.monotonic_ns()

    def now_s(self) -> float:
        return 1e-9 * (time.monotonic_ns() - self.origin_ns)


def live_real(
    devices: Sequence[SimulatedDevice],
    clock: Clock,
    script: ScriptClock,
    end_s: float | None,
    stopped: Callable[[], bool],
) -> None:
    """Follow the clock. Instants are absolute, so that nothing drifts.

    Without ``end_s`` it continues after the script.
    """
    while not stopped():
        now_s = clock.now_s()
        for device in devices:
            device.live(now_s)
        if _over(script, end_s, now_s):
            return
        due_s = min(device.next_due_s(BLOCK_S) for device in devices)
        _wait(devices, min(due_s - clock.now_s(), IDLE_S))


def live_fast(
    devices: Sequence[SimulatedDevice],
    clock: Clock,
    script: ScriptClock,
    end_s: float | None,
    stopped: Callable[[], bool],
) -> None:
    """Advance time as the host reads during a stream, else follow the clock.

    Arguments as in `live_real`.
    """
    now_s, last_s, moved_s = 0.0, clock.now_s(), 0.0
    while not stopped():
        for device in devices:
            device.live(now_s)
        if _over(script, end_s, now_s):
            return
        real_s = clock.now_s()
        if not any(device.streaming for device in devices):
            now_s += real_s - last_s
            moved_s = real_s
            _wait(devices, IDLE_S)
        elif any(device.ahead for device in devices) and real_s - moved_s < PATIENCE_S:
            _wait(devices, IDLE_S)
        else:
            now_s += FAST_STEP_S
            moved_s = real_s
        last_s = real_s


def _over(script: ScriptClock, end_s: float | None, now_s: float) -> bool:
    if end_s is None or script.begin_s is None:
        return False
    return script.script_s(now_s) > end_s + LINGER_S


def _wait(devices: Sequence[SimulatedDevice], timeout_s: float) -> None:
    """Sleep until a host writes or can read, at most for a time."""
    readers = [number for device in devices for number in device.readers()]
    writers = [number for device in devices for number in device.writers()]
    select.select(readers, writers, [], max(0.0, timeout_s))

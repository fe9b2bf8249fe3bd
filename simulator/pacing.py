"""Lets devices live: in real time, or as fast as the host reads."""

import select
from collections.abc import Callable, Sequence

from simulator.clock import Clock
from simulator.device import Device
from simulator.wiring import ScriptClock

BLOCK_S = 0.002  # samples of so long are computed and sent together
IDLE_S = 0.020  # at least so often the ports are looked at
FAST_STEP_S = 0.020
LINGER_S = 0.5  # at the end of a script: the last edges get their acknowledgement
MOST_EDGES_AHEAD = 4  # unacknowledged, before fast time waits for the host
PATIENCE_S = 0.5  # and so long it waits


def live_real(
    devices: Sequence[Device],
    clock: Clock,
    script: ScriptClock,
    end_s: float | None,
    stopped: Callable[[], bool],
) -> None:
    """Follow the clock. Instants are absolute, so nothing drifts.

    Args:
        devices: All of them.
        clock: Time of the simulation.
        script: When the script began.
        end_s: End of the script, None to go on.
        stopped: Asked whether to end.
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
    devices: Sequence[Device],
    clock: Clock,
    script: ScriptClock,
    end_s: float | None,
    stopped: Callable[[], bool],
) -> None:
    """Let time run as the host reads while a stream runs, else follow the clock.

    Arguments are those of `live_real`.
    """
    now_s, last_s, moved_s = 0.0, clock.now_s(), 0.0
    while not stopped():
        for device in devices:
            device.live(now_s)
        if _over(script, end_s, now_s):
            return
        real_s = clock.now_s()
        open_devices = [device for device in devices if device.port is not None]
        if not any(device.board.streaming for device in open_devices):
            now_s += real_s - last_s
            moved_s = real_s
            _wait(devices, IDLE_S)
        elif _ahead(open_devices) and real_s - moved_s < PATIENCE_S:
            _wait(devices, IDLE_S)
        else:
            now_s += FAST_STEP_S
            moved_s = real_s
        last_s = real_s


def _ahead(devices: Sequence[Device]) -> bool:
    """Whether the host is still busy with what it was sent."""
    return any(
        (device.port is not None and device.port.backlog)
        or len(device.board.edges) > MOST_EDGES_AHEAD
        for device in devices
    )


def _over(script: ScriptClock, end_s: float | None, now_s: float) -> bool:
    if end_s is None or script.begin_s is None:
        return False
    return script.script_s(now_s) > end_s + LINGER_S


def _wait(devices: Sequence[Device], timeout_s: float) -> None:
    """Sleep until a host writes or can read on, at most for a time."""
    ports = [device.port for device in devices if device.port and device.port.held]
    readers = [port.descriptor for port in ports]
    writers = [port.descriptor for port in ports if port.backlog]
    select.select(readers, writers, [], max(0.0, timeout_s))

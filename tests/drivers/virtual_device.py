"""A driver in virtual time with a device of the simulator behind it.

The encoders turn steadily: channel k shows 1000 (t + k) counts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.virtual_time import (
    Cable,
    Straight,
    VirtualTime,
    lines_through,
    played,
)
from tests.drivers.delivered import Delivered
from tests.simulator.one_hinge import mounted
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import DeviceAlarm
from traverse.drivers.io.ports import PortAccess
from traverse.simulator.devices.device import make_device

FIRST_NS = 10**12


@dataclass
class Recorded(Delivered):
    all: list[Any]
    notes: Any
    totals: dict[str, Any] = field(default_factory=dict)

    def alarms(self) -> list[tuple[int | None, str, bool]]:
        return [(a.channel, a.code, a.raised) for a in self.of(DeviceAlarm)]

    def read_ns(self) -> np.ndarray:
        """(n, n_channels) instants of the readings, from the time's begin."""
        skew = self.joined("skew_ns")
        return self.joined("sample_time_ns")[:, np.newaxis] + skew - FIRST_NS

    def counts_at(self, read_ns: np.ndarray) -> np.ndarray:
        """Counts of the encoders at instants, (n, n_channels), without wraps."""
        ahead = np.arange(read_ns.shape[1])
        return 1000.0 * (read_ns * 1e-9 + ahead)


def told_by(
    make: Callable[..., Driver],
    table: Any,
    folder: Path,
    lines: Sequence[str],
    *faults: dict[str, Any],
    seconds: float = 1.0,
    rate_hz: float = 100.0,
    per_turn: int = 65536,
    n_channels: int = 2,
    device_class: Callable[..., Any] = make_device,
    **options: Any,
) -> Recorded:
    """Let a driver read a simulated device for a time.

    Args:
        make: The driver's class.
        table: Of the simulated device.
        folder: For its ports; nothing is put there.
        lines: Ports of its lines.
        faults: Of the device.
        seconds: How long.
        rate_hz: Of the stream.
        per_turn: Counts of its encoders.
        n_channels: How many encoders.
        device_class: Makes the device.
        options: Of the driver.
    """
    time = VirtualTime(seconds)
    cables = {port: Cable(time) for port in lines}
    mounting = mounted(folder, table, *faults, n_channels=n_channels, per_turn=per_turn)
    with lines_through(list(cables.values())):
        device = device_class(table, mounting)
    time.devices = [device]
    straight = Straight(time.over)

    def open_port(path: str, baud_rate: int, wake_fd: int, **line: object):
        return cables[path].open_port(path, baud_rate, wake_fd)

    driver = make(
        "wrist",
        make.options_class(**options),
        straight,
        monotonic_ns=time.monotonic_ns,
        ports=PortAccess(open_port, time.wait_for_any),
    )
    driver.request_stream(rate_hz)
    played(driver, time.over)
    return Recorded(straight.all, mounting.notes, device.totals())

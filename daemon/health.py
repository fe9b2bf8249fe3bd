"""Figures of the daemon, taken every few seconds."""

import resource
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from traverse.daemon.acquisition.device import Device
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.latencies import Latencies
from traverse.kinematics.kernel.choice import KERNEL
from traverse.protocol.messages import (
    BrokerHealth,
    Health,
    OutboxHealth,
    RecordingHealth,
    SpoolHealth,
)
from traverse.protocol.messages.health import LATENCIES

SUMMED = (
    "samples_received",
    "samples_lost",
    "samples_dropped",
    "edges_received",
    "edges_lost",
    "frames_received",
    "frames_rejected",
)
RATES = ("samples_received", "points_captured", "scan_points_published")


class HealthReport:
    """Collects figures and makes the health message.

    Args:
        clock: the host's.
    """

    def __init__(self, clock: HostClock) -> None:
        self._clock = clock
        self._start_ns = clock.monotonic_ns()
        self._last_ns = self._start_ns
        self._last_cpu_s = time.process_time()
        self._last: Counter[str] = Counter()
        self._last_samples: Counter[str] = Counter()
        self.latencies = {name: Latencies() for name in LATENCIES}

    def message(
        self,
        *,
        arm: str,
        session: str,
        devices: Sequence[Device],
        broker: BrokerHealth,
        outbox: OutboxHealth,
        spool: SpoolHealth | None,
        recording: RecordingHealth,
        counters: Mapping[str, int],
        temperature_c: float | None,
        lacks: Mapping[str, Mapping[str, int]],
        skew_mm: float | None,
        anew: bool = True,
    ) -> Health:
        """The figures since the last call with ``anew``.

        Args:
            arm: its name.
            session: that points belong to.
            devices: all of the configuration.
            broker: the connection to it.
            outbox: the points on disk.
            spool: the scans on disk.
            recording: recordings on disk.
            counters: of everything but devices.
            temperature_c: of the arm.
            lacks: counters of what the arm's samples lacked, by device.
            skew_mm: see the message.
            anew: the next figures are those since this call; else it only looks.
        """
        now_ns = self._clock.monotonic_ns()
        elapsed_s = max(1e-3, (now_ns - self._last_ns) * 1e-9)
        cpu_s = time.process_time()
        totals = Counter(counters)
        for device in devices:
            for name in SUMMED:
                totals[name] += device.counters[name]
            totals["reconnects"] += device.reconnects
            totals.update(lacks.get(device.section.id, {}))
        rates_hz = {
            name: max(0, totals[name] - self._last[name]) / elapsed_s for name in RATES
        }
        message = Health(
            arm=arm,
            session=session,
            time_ns=now_ns + self._clock.utc_offset_ns(),
            uptime_s=(now_ns - self._start_ns) * 1e-9,
            kernel=KERNEL,
            cpu_share=(cpu_s - self._last_cpu_s) / elapsed_s,
            rss_bytes=_resident_bytes(),
            counters={name: max(0, value) for name, value in totals.items()},
            rates_hz=rates_hz,
            latencies={
                name: figures
                for name, latencies in self.latencies.items()
                if (figures := latencies.figures()) is not None
            },
            temperatures_c={} if temperature_c is None else {"arm": temperature_c},
            skew_mm=skew_mm,
            broker=broker,
            outbox=outbox,
            spool=spool,
            recording=recording,
            devices=tuple(
                device.health(
                    self._rate_hz(device, elapsed_s),
                    now_ns,
                    lacks.get(device.section.id, {}),
                )
                for device in devices
            ),
        )
        if anew:
            self._last_ns, self._last_cpu_s, self._last = now_ns, cpu_s, totals
            self._last_samples = Counter({d.section.id: d.samples for d in devices})
            for latencies in self.latencies.values():
                latencies.clear()
        return message

    def _rate_hz(self, device: Device, elapsed_s: float) -> float:
        return (device.samples - self._last_samples[device.section.id]) / elapsed_s


def _resident_bytes() -> int:
    """Resident memory; the largest so far where the system does not report it."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return pages * resource.getpagesize()

"""The messages `status` and `health`."""

import resource
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.dispatcher import CommandDispatcher
from traverse.daemon.conditions.monitor import Standing
from traverse.daemon.config.filters import removed_counters
from traverse.daemon.measurement import Measurement
from traverse.daemon.monitoring.events import Occurrence
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.scan_store import ScanStore
from traverse.daemon.system.standard_error import STANDARD_ERROR
from traverse.kinematics.model.kernel_choice import KERNEL
from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import (
    Alarm,
    BrokerHealth,
    ConditionStanding,
    Health,
    OutboxHealth,
    RecordingHealth,
    SpoolHealth,
    Status,
)
from traverse.protocol.messages.later_doubt import LaterDoubt

MAX_ALARMS = 64  # in a status
MAX_PROBES = 64
MAX_CONDITIONS = 256
MAX_DOUBTS = 16
MAX_TEXT = 2000
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


def status_message(
    measurement: Measurement,
    clock: HostClock,
    encoding: Encoding,
    *,
    keeps_points: bool,
    active: Sequence[Occurrence] = (),
    doubts: Iterable[LaterDoubt] = (),
    public_key: str | None = None,
    online: bool = True,
) -> Status:
    """Return the status, or that of a daemon that has ended."""
    arrangement: dict[str, Any] = {}  # which the last will cannot tell
    if online:
        probe, probes = measurement.probe, measurement.probes
        alignment = measurement.alignment.alignment
        arrangement = {
            "alarms": tuple(_alarm(alarm, clock) for alarm in active[:MAX_ALARMS]),
            "doubts": tuple(doubts)[-MAX_DOUBTS:],
            "probe": None if probe is None else probe.name,
            "probes": None if probes is None else probes[:MAX_PROBES],
            "label": measurement.capture.label,
            "alignment": None if alignment is None else alignment.name,
            "public_key": public_key,
            "conditions": tuple(
                _condition(standing, clock)
                for standing in measurement.conditions.standings[:MAX_CONDITIONS]
            ),
        }
    return Status(
        online=online,
        state=_state(measurement, keeps_points) if online else "offline",
        arm=measurement.model.name,
        model=measurement.model.digest,
        version=version("traverse-cmm"),
        kernel=KERNEL,
        encoding=encoding,
        session=measurement.capture.session.id,
        time_ns=clock.monotonic_ns() + clock.utc_offset_ns(),
        drivers=tuple(device.status() for device in measurement.devices.values()),
        **arrangement,
    )


def _state(
    measurement: Measurement, keeps_points: bool
) -> Literal["ready", "doubt", "degraded"]:
    devices = measurement.devices.values()
    if not keeps_points or any(device.state != "ready" for device in devices):
        return "degraded"
    return "ready" if measurement.conditions.all_established else "doubt"


def _condition(standing: Standing, clock: HostClock) -> ConditionStanding:
    return ConditionStanding(
        name=standing.name,
        source=standing.subject,
        established=standing.established,
        since_ns=clock.to_utc_ns(standing.since_ns),
        cause=standing.cause[:MAX_TEXT],
        remedy=standing.remedy[:MAX_TEXT],
        command=standing.condition.command,
    )


def _alarm(occurrence: Occurrence, clock: HostClock) -> Alarm:
    names = ("severity", "code", "source", "text", "remedy")
    same = {name: getattr(occurrence, name) for name in names}
    return Alarm(**same, since_ns=clock.to_utc_ns(occurrence.first_ns))


class HealthReporter:
    """Makes health messages; keeps the last figures for rates."""

    def __init__(self, clock: HostClock, latencies: Mapping[str, Latencies]) -> None:
        self._clock = clock
        self._latencies = latencies
        self._start_ns = clock.monotonic_ns()
        self._last_ns = self._start_ns
        self._last_cpu_s = time.process_time()
        self._last: Counter[str] = Counter()
        self._last_samples: Counter[str] = Counter()

    def message(
        self,
        measurement: Measurement,
        *,
        broker: BrokerHealth,
        outbox: OutboxHealth,
        spool: SpoolHealth | None,
        recording: RecordingHealth,
        counters: Mapping[str, int],
        anew: bool = True,
    ) -> Health:
        """Return the figures since the last call with ``anew``."""
        now_ns, cpu_s = self._clock.monotonic_ns(), time.process_time()
        elapsed_s = max(1e-3, (now_ns - self._last_ns) * 1e-9)
        devices = measurement.devices.values()
        temperature_c = measurement.joint_devices.temperature_c
        lacks = measurement.resampler.lacks()
        totals = Counter(counters)
        for device in devices:
            for name in SUMMED:
                totals[name] += device.counters[name]
            totals["reconnects"] += device.reconnects
            totals.update(lacks.get(device.section.id, {}))
        message = Health(
            arm=measurement.model.name,
            session=measurement.capture.session.id,
            time_ns=now_ns + self._clock.utc_offset_ns(),
            uptime_s=(now_ns - self._start_ns) * 1e-9,
            kernel=KERNEL,
            cpu_share=(cpu_s - self._last_cpu_s) / elapsed_s,
            rss_bytes=_resident_bytes(),
            counters={name: max(0, value) for name, value in totals.items()},
            rates_hz={
                name: max(0, totals[name] - self._last[name]) / elapsed_s
                for name in RATES
            },
            latencies={
                name: figures
                for name, latencies in self._latencies.items()
                if (figures := latencies.figures()) is not None
            },
            temperatures_c={} if temperature_c is None else {"arm": temperature_c},
            skew_mm=measurement.skew.pop_largest_mm(),
            broker=broker,
            outbox=outbox,
            spool=spool,
            recording=recording,
            devices=tuple(
                device.health(
                    (device.samples - self._last_samples[name]) / elapsed_s,
                    now_ns,
                    lacks.get(name, {}),
                )
                for name, device in measurement.devices.items()
            ),
        )
        if anew:
            self._last_ns, self._last_cpu_s, self._last = now_ns, cpu_s, totals
            self._last_samples = Counter({d.section.id: d.samples for d in devices})
            for latencies in self._latencies.values():
                latencies.clear()
        return message


def _resident_bytes() -> int:
    """Return resident memory; its maximum if the system reports no more."""
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return pages * resource.getpagesize()


def health_counters(
    measurement: Measurement,
    spool: ScanStore,
    commands: CommandDispatcher,
    connection: BrokerConnection,
    queue: OutgoingQueue,
) -> dict[str, int]:
    capture, scanner = measurement.capture, measurement.scanner
    return {
        "points_captured": capture.captured,
        "points_retracted": capture.retracted,
        "points_refused": capture.refused,
        "points_published": queue.sent["point"],
        "points_resent": queue.sent["resend"],
        "scan_points_published": scanner.published_points,
        "scan_points_dropped": scanner.dropped_points,
        "scan_blocks_kept": spool.counters["kept"],
        "scan_blocks_unkept": spool.counters["unkept"],
        "scan_blocks_dropped": spool.counters["dropped"] + queue.dropped["scan"],
        "live_published": queue.sent["live"],
        "live_thinned": measurement.live.thinned + queue.dropped["live"],
        "events_published": queue.sent["event"],
        "events_dropped": queue.dropped["event"],
        "messages_too_long": queue.too_long.total(),
        "log_lines_dropped": STANDARD_ERROR.n_dropped,
        "commands_received": commands.received,
        "commands_refused": commands.refused,
        "reconnects": connection.reconnects,
        **removed_counters(scanner.chain),
    }

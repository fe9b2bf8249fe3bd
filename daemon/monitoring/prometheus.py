"""All figures of health as Prometheus wants them: base units, totals since start."""

from collections.abc import Iterable, Mapping

from traverse.daemon.monitoring.exposition import family, histogram
from traverse.daemon.monitoring.latencies import Latencies
from traverse.protocol.messages import Health
from traverse.protocol.messages.health import COUNTERS, LATENCIES, LATENCY_BOUNDS_US

STATES = ("starting", "ready", "lost", "failed", "stopped")
CONNECTION = ("connecting", "connected", "lost")
OUTBOX = ("ready", "failed")
SPOOL = {
    "blocks": "blocks of scans kept on the disk",
    "unsent": "blocks on the disk that the broker does not have yet",
    "bytes": "size of the spool",
}
RECORDING = ("off", "flight", "recording", "failed")
BOUNDS_S = [bound_us / 1e6 for bound_us in LATENCY_BOUNDS_US]


def exposition(
    health: Health,
    latencies: Mapping[str, Latencies],
    cpu_s: float,
    version: str,
) -> str:
    """The text that a scrape gets.

    Args:
        health: the figures of now.
        latencies: all since the start, by name.
        cpu_s: CPU time that the process has used.
        version: of the daemon.
    """
    about = {"arm": health.arm, "version": version, "kernel": health.kernel}
    return "".join(
        (
            family("traverse_info", "gauge", "the daemon; always 1", [(about, 1)]),
            family(
                "traverse_uptime_seconds",
                "gauge",
                "time since the daemon's start",
                [({}, health.uptime_s)],
            ),
            family(
                "traverse_cpu_seconds_total",
                "counter",
                "CPU time that the daemon has used",
                [({}, cpu_s)],
            ),
            family(
                "traverse_resident_memory_bytes",
                "gauge",
                "resident memory of the daemon",
                [({}, health.rss_bytes)],
            ),
            family(
                "traverse_temperature_celsius",
                "gauge",
                "temperatures used by the corrections",
                [({"of": name}, c) for name, c in health.temperatures_c.items()],
            ),
            family(
                "traverse_skew_meters",
                "gauge",
                "largest error of position that reading the joints at different "
                "instants may have left since the previous health message",
                [] if health.skew_mm is None else [({}, health.skew_mm / 1000)],
            ),
            *_counters(health),
            *_broker(health),
            *_outbox(health),
            *_spool(health),
            *_recording(health),
            *_devices(health),
            histogram(
                "traverse_latency_seconds",
                "; ".join(f"{name}: {text}" for name, text in LATENCIES.items()),
                BOUNDS_S,
                [
                    ({"of": name}, each.total_counts, each.total_ns * 1e-9)
                    for name, each in latencies.items()
                ],
            ),
        )
    )


def _counters(health: Health) -> Iterable[str]:
    for name, value in sorted(health.counters.items()):
        text = COUNTERS.get(name, "points of scans held back by this filter")
        yield family(f"traverse_{name}_total", "counter", text, [({}, value)])


def _broker(health: Health) -> Iterable[str]:
    broker = health.broker
    yield family(
        "traverse_broker_state",
        "gauge",
        "1 for the state that the connection to the broker is in",
        [({"state": state}, state == broker.state) for state in CONNECTION],
    )
    yield family(
        "traverse_broker_reconnects_total",
        "counter",
        "times that the connection to the broker came back",
        [({}, broker.reconnects)],
    )
    yield family(
        "traverse_messages_queued",
        "gauge",
        "messages that wait to be published",
        [({}, broker.queued)],
    )
    yield family(
        "traverse_messages_unacknowledged",
        "gauge",
        "messages published that the broker has not acknowledged",
        [({}, broker.unacknowledged)],
    )
    yield family(
        "traverse_messages_dropped_total",
        "counter",
        "messages dropped because the queue was full",
        [({}, broker.dropped)],
    )


def _outbox(health: Health) -> Iterable[str]:
    outbox = health.outbox
    yield family(
        "traverse_outbox_state",
        "gauge",
        "1 for the state that the outbox is in",
        [({"state": state}, state == outbox.state) for state in OUTBOX],
    )
    yield family(
        "traverse_outbox_points",
        "gauge",
        "points kept on the disk, retractions included",
        [({}, outbox.points)],
    )
    yield family(
        "traverse_outbox_points_unsent",
        "gauge",
        "points on the disk that the broker does not have yet",
        [({}, outbox.unsent)],
    )
    yield family(
        "traverse_outbox_bytes", "gauge", "size of the outbox", [({}, outbox.bytes)]
    )
    oldest_ns = outbox.oldest_unsent_ns
    yield family(
        "traverse_outbox_oldest_unsent_seconds",
        "gauge",
        "age of the first point that the broker does not have yet",
        [] if oldest_ns is None else [({}, (health.time_ns - oldest_ns) * 1e-9)],
    )


def _spool(health: Health) -> Iterable[str]:
    spool = health.spool
    yield family(
        "traverse_spool_state",
        "gauge",
        "1 for the state that the spool of scans is in; none while it is not used",
        [] if spool is None else [({"state": s}, s == spool.state) for s in OUTBOX],
    )
    for name, text in SPOOL.items():
        value = None if spool is None else spool.model_dump()[name]
        yield family(
            f"traverse_spool_{name}",
            "gauge",
            text,
            [] if value is None else [({}, value)],
        )


def _recording(health: Health) -> Iterable[str]:
    recording = health.recording
    yield family(
        "traverse_recording_state",
        "gauge",
        "1 for the state that the recorder is in",
        [({"state": state}, state == recording.state) for state in RECORDING],
    )
    yield family(
        "traverse_recording_queued",
        "gauge",
        "items that wait to be recorded",
        [({}, recording.queued)],
    )
    yield family(
        "traverse_recording_dropped_total",
        "counter",
        "items not recorded for want of room",
        [({}, recording.dropped)],
    )


def _devices(health: Health) -> Iterable[str]:
    devices = [({"device": device.id}, device) for device in health.devices]
    yield family(
        "traverse_device_state",
        "gauge",
        "1 for the state that the device is in",
        [
            ({**labels, "state": state}, state == device.state)
            for labels, device in devices
            for state in STATES
        ],
    )
    yield family(
        "traverse_device_silence_seconds",
        "gauge",
        "time since the device was last heard",
        [
            (labels, device.age_s)
            for labels, device in devices
            if device.age_s is not None
        ],
    )
    yield family(
        "traverse_device_samples_queued",
        "gauge",
        "samples that wait between the reader thread and the pipeline",
        [(labels, device.queued) for labels, device in devices],
    )
    yield family(
        "traverse_device_temperature_celsius",
        "gauge",
        "the device's own sensors",
        [
            ({**labels, "sensor": sensor}, value)
            for labels, device in devices
            for sensor, value in device.temperatures_c.items()
        ],
    )
    yield family(
        "traverse_device_counters_total",
        "counter",
        "counters of the device and its driver since it was opened, by name",
        [
            ({**labels, "counter": name}, value)
            for labels, device in devices
            for name, value in sorted(device.counters.items())
        ],
    )

"""Health figures in Prometheus' text format, version 0.0.4.

Base units, totals since the start; docs/reference/metrics.md explains each.
"""

from collections.abc import Iterable, Mapping, Sequence

from traverse.daemon.monitoring.latencies import Latencies
from traverse.protocol.messages import Health
from traverse.protocol.messages.health import COUNTERS, LATENCIES, LATENCY_BOUNDS_US

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
STATES = ("starting", "ready", "lost", "failed", "stopped")
CONNECTION = ("connecting", "connected", "lost")
OUTBOX = ("ready", "failed")
RECORDING = ("off", "flight", "recording", "failed")
BOUNDS_S = [bound_us / 1e6 for bound_us in LATENCY_BOUNDS_US]
HELP = {
    "info": "the daemon; always 1",
    "uptime_seconds": "time since the daemon's start",
    "cpu_seconds_total": "CPU time that the daemon has used",
    "resident_memory_bytes": "resident memory of the daemon",
    "temperature_celsius": "temperatures used by the corrections",
    "skew_meters": "largest error of position that reading the joints at different "
    "instants may have left since the previous health message",
    "broker_state": "1 for the state that the connection to the broker is in",
    "broker_reconnects_total": "reconnections to the broker",
    "messages_queued": "messages that wait to be published",
    "messages_unacknowledged": "messages published that the broker has not "
    "acknowledged",
    "messages_dropped_total": "messages dropped because the queue was full",
    "outbox_state": "1 for the state that the outbox is in",
    "outbox_points": "points kept on the disk, retractions included",
    "outbox_points_unsent": "points on the disk that the broker does not have yet",
    "outbox_bytes": "size of the outbox",
    "outbox_oldest_unsent_seconds": "age of the first point that the broker does not "
    "have yet",
    "spool_state": "1 for the state that the spool of scans is in; none while it is "
    "not used",
    "spool_blocks": "blocks of scans kept on the disk",
    "spool_unsent": "blocks on the disk that the broker does not have yet",
    "spool_bytes": "size of the spool",
    "recording_state": "1 for the state that the recorder is in",
    "recording_queued": "items that wait to be recorded",
    "recording_dropped_total": "items not recorded because the queue was full",
    "condition_established": "1 while a condition that numbers rest on is "
    "established, 0 while numbers are in doubt for the lack of it",
    "device_state": "1 for the state that the device is in",
    "device_silence_seconds": "time since the device last sent anything",
    "device_samples_queued": "samples that wait between the reader thread and the "
    "pipeline",
    "device_temperature_celsius": "the device's own sensors",
    "device_counters_total": "counters of the device and its driver since it was "
    "opened, by name",
    **{f"{name}_total": text for name, text in COUNTERS.items()},
}
"""Help texts by name without prefix."""
HELP_OF_FILTERS = "points of scans held back by this filter"

Labels = Mapping[str, str]
Samples = list[tuple[Labels, float]]
Values = dict[str, float | Samples | None]
"""Samples, one value, or None, by name without prefix."""


def exposition(
    health: Health,
    latencies: Mapping[str, Latencies],
    cpu_s: float,
    version: str,
    conditions: Mapping[tuple[str, str], bool],
) -> str:
    """Format the page; latencies are since the start.

    ``conditions`` states by name and source which are established.
    """
    values = _process(health, cpu_s, version) | _queues(health) | _devices(health)
    values["condition_established"] = [
        ({"condition": name, "source": source}, int(established))
        for (name, source), established in conditions.items()
    ]
    families = [
        family(f"traverse_{name}", HELP.get(name, HELP_OF_FILTERS), value)
        for name, value in values.items()
    ]
    text = "; ".join(f"{name}: {text}" for name, text in LATENCIES.items())
    durations = [
        ({"of": name}, each.total_counts, each.total_ns * 1e-9)
        for name, each in latencies.items()
    ]
    families.append(histogram("traverse_latency_seconds", text, BOUNDS_S, durations))
    return "".join(families)


def _process(health: Health, cpu_s: float, version: str) -> Values:
    about = {"arm": health.arm, "version": version, "kernel": health.kernel}
    return {
        "info": [(about, 1)],
        "uptime_seconds": health.uptime_s,
        "cpu_seconds_total": cpu_s,
        "resident_memory_bytes": health.rss_bytes,
        "temperature_celsius": [
            ({"of": name}, c) for name, c in health.temperatures_c.items()
        ],
        "skew_meters": None if health.skew_mm is None else health.skew_mm / 1000,
        **{f"{name}_total": n for name, n in sorted(health.counters.items())},
    }


def _queues(health: Health) -> Values:
    """Return figures of messages on their way to broker and disk."""
    broker, outbox, spool = health.broker, health.outbox, health.spool
    recording, oldest_ns = health.recording, outbox.oldest_unsent_ns
    return {
        "broker_state": _states(CONNECTION, broker.state),
        "broker_reconnects_total": broker.reconnects,
        "messages_queued": broker.queued,
        "messages_unacknowledged": broker.unacknowledged,
        "messages_dropped_total": broker.dropped,
        "outbox_state": _states(OUTBOX, outbox.state),
        "outbox_points": outbox.points,
        "outbox_points_unsent": outbox.unsent,
        "outbox_bytes": outbox.bytes,
        "outbox_oldest_unsent_seconds": None
        if oldest_ns is None
        else (health.time_ns - oldest_ns) * 1e-9,
        "spool_state": None if spool is None else _states(OUTBOX, spool.state),
        "spool_blocks": None if spool is None else spool.blocks,
        "spool_unsent": None if spool is None else spool.unsent,
        "spool_bytes": None if spool is None else spool.bytes,
        "recording_state": _states(RECORDING, recording.state),
        "recording_queued": recording.queued,
        "recording_dropped_total": recording.dropped,
    }


def _devices(health: Health) -> Values:
    devices = [({"device": device.id}, device) for device in health.devices]
    return {
        "device_state": [
            ({**labels, **state}, value)
            for labels, device in devices
            for state, value in _states(STATES, device.state)
        ],
        "device_silence_seconds": [
            (labels, device.age_s)
            for labels, device in devices
            if device.age_s is not None
        ],
        "device_samples_queued": [
            (labels, device.queued) for labels, device in devices
        ],
        "device_temperature_celsius": [
            ({**labels, "sensor": sensor}, value)
            for labels, device in devices
            for sensor, value in device.temperatures_c.items()
        ],
        "device_counters_total": [
            ({**labels, "counter": name}, value)
            for labels, device in devices
            for name, value in sorted(device.counters.items())
        ],
    }


def _states(states: Iterable[str], current: str) -> Samples:
    return [({"state": state}, state == current) for state in states]


def family(name: str, text: str, value: float | Samples | None) -> str:
    """Format a family of one value, or of labels and values; empty without samples.

    The name contains the unit; that of a counter ends in `_total`.
    """
    if value is None or value == []:
        return ""
    samples = value if isinstance(value, list) else [({}, value)]
    kind = "counter" if name.endswith("_total") else "gauge"
    lines = [f"{name}{_labels(labels)} {_number(value)}" for labels, value in samples]
    return "\n".join([*_head(name, kind, text), *lines, ""])


def histogram(
    name: str,
    text: str,
    bounds: Sequence[float],
    samples: Iterable[tuple[Labels, Sequence[int], float]],
) -> str:
    """Format a family of histograms; the name contains the unit.

    A sample has labels, counts by bin (``bounds`` are upper bounds of all but the
    last), and the sum.
    """
    lines = []
    for labels, counts, total in samples:
        below = 0
        for bound, count in zip([*bounds, float("inf")], counts, strict=True):
            below += count
            limits = {**labels, "le": _number(bound)}
            lines.append(f"{name}_bucket{_labels(limits)} {below}")
        lines.append(f"{name}_sum{_labels(labels)} {_number(total)}")
        lines.append(f"{name}_count{_labels(labels)} {below}")
    return "\n".join([*_head(name, "histogram", text), *lines, ""]) if lines else ""


def _head(name: str, kind: str, text: str) -> tuple[str, str]:
    escaped = text.replace("\\", "\\\\").replace("\n", "\\n")
    return f"# HELP {name} {escaped}", f"# TYPE {name} {kind}"


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    pairs = ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items())
    return f"{{{pairs}}}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _number(value: float) -> str:
    """Format a number as Prometheus does: +Inf, integers without a point."""
    if value == float("inf"):
        return "+Inf"
    return str(int(value)) if float(value).is_integer() else repr(float(value))

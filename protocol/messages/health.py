"""Health: figures of the daemon, retained and sent every few seconds."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from traverse.protocol.messages.fields import (
    ArmName,
    Count,
    Message,
    Name,
    NotNegative,
    Text,
    TimeNs,
    Value,
    Word,
    schema_field,
)


class RecordingHealth(Value):
    """Recordings on the daemon's disk."""

    state: Literal["off", "flight", "recording", "failed"]
    """"flight": the last minutes alone; "failed": not even these, see the event."""
    name: Name | None
    """Name of the requested recording; null without one."""
    bytes: Count
    """Length of its file so far."""
    flight_bytes: Count
    """Written by the flight recorder since the daemon's start, before compression."""
    queued: Count
    """Items waiting to be written."""
    dropped: Count
    """Items not recorded because the queue was full."""
    kept: Count
    """Files kept after faults since the daemon's start."""
    kept_dropped: Count
    """Older such files deleted for them."""


COUNTERS = {
    "samples_received": "sets of counts received from the devices",
    "samples_lost": "sets of counts missing in the devices' numbering",
    "samples_dropped": "sets of counts dropped because a queue was full",
    "edges_received": "input edges received from the devices",
    "edges_lost": "input edges missing in the devices' numbering",
    "frames_received": "whole frames received from the devices",
    "frames_rejected": "frames dropped for a wrong checksum, length or type",
    "messages_too_long": "messages longer than the broker takes, left out",
    "log_lines_dropped": "lines of the log that standard error did not take",
    "points_captured": "points, retractions not counted",
    "points_retracted": "points taken back",
    "points_refused": "triggers that made no point; see the event",
    "points_published": "points acknowledged by the broker, retractions included",
    "points_resent": "points acknowledged that were requested again",
    "scan_points_published": "points of scans sent to the broker",
    "scan_points_dropped": "points of scans dropped because a queue was full",
    "scan_blocks_kept": "blocks of scans stored on the disk before they were sent",
    "scan_blocks_unkept": "blocks of scans sent without that, as the disk failed",
    "scan_blocks_dropped": "blocks of scans dropped because a queue or the spool was "
    "full",
    "scan_filter_n_kind": "points of scans held back by filter n of that kind",
    "live_published": "live poses sent to the broker",
    "live_thinned": "live poses left out to keep to the display rate",
    "events_published": "events sent to the broker",
    "events_dropped": "events dropped because a queue was full",
    "commands_received": "commands received, valid or not",
    "commands_refused": "commands answered with an error",
    "samples_late": "sets of counts completed with a device's last readings",
    "samples_incomplete": "sets of counts that lack readings of a device",
    "samples_held_back": "sets of counts not used: readings of a device lacked",
    "reconnects": "reconnections of a device or the broker",
}
"""Names of counters since the daemon's start, or a device's opening."""

LATENCIES = {
    "capture_to_publish": "from a trigger's receipt to sending the point",
    "point_to_disk": "from a point's number to its commit on the disk",
    "publish_to_ack": "from sending a point to the broker's acknowledgement",
    "sample_to_pose": "from a sample's receipt to its coordinates",
    "queue_wait": "time of a block of samples between reader thread and pipeline",
    "handling": "time that the event loop needs for one delivery of a device",
    "collection": "pause of the interpreter's garbage collection",
}
"""Names of latencies, over the time since the previous health message."""

LATENCY_BOUNDS_US = tuple(
    digit * 10**power for power in range(1, 7) for digit in (1, 2, 5)
)
"""Upper bounds of the bins of a latency's histogram; the last bin has none."""


class Latency(Value):
    """Distribution of a delay since the previous health message."""

    p50_us: NotNegative
    """Median in microseconds."""
    p99_us: NotNegative
    """99th percentile in microseconds."""
    max_us: NotNegative
    """Largest in microseconds."""
    n: Annotated[Count, Field(ge=1)]
    """How many were measured; a delay never measured is left out."""
    histogram: Annotated[
        tuple[Count, ...],
        Field(
            min_length=len(LATENCY_BOUNDS_US) + 1, max_length=len(LATENCY_BOUNDS_US) + 1
        ),
    ]
    """How many lie in each bin, up to and with its bound: 10, 20, 50, 100 ... 5 000 000
    microseconds (1, 2, 5 in each decade); the last bin has no bound."""

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        if not self.p50_us <= self.p99_us <= self.max_us:
            raise ValueError("p50_us <= p99_us <= max_us")
        if sum(self.histogram) != self.n:
            raise ValueError("a histogram of n values")
        return self


class BrokerHealth(Value):
    """The connection to the broker, as seen by the daemon."""

    state: Literal["connecting", "connected", "lost"]
    """"lost": was connected and tries again."""
    host: Text
    """Host name or address."""
    port: Annotated[int, Field(ge=1, le=65535)]
    """TCP port."""
    reconnects: Count
    """Number of reconnections."""
    queued: Count
    """Messages waiting to be published."""
    queue_limit: Count
    """So many may wait."""
    unacknowledged: Count
    """Messages published with QoS 1 and not yet acknowledged."""
    dropped: Count
    """Messages dropped because the queue was full."""


class OutboxHealth(Value):
    """The points on the daemon's disk."""

    state: Literal["ready", "failed"]
    """"failed": no point can be stored, so none is taken; see the event."""
    points: Count
    """Points stored, retractions included."""
    unsent: Count
    """Those of them that the broker has not acknowledged yet."""
    bytes: Count
    """Size of the file."""
    oldest_unsent_ns: TimeNs | None
    """Time of the first point that the broker does not have; null: it has all. [UTC]"""


class SpoolHealth(Value):
    """The scans on the daemon's disk."""

    state: Literal["ready", "failed"]
    """"failed": blocks are sent without being stored; see the event."""
    blocks: Count
    """Blocks stored."""
    unsent: Count
    """Those of them that the broker has not acknowledged yet."""
    bytes: Count
    """Size of the file."""


class DeviceHealth(Value):
    """One device."""

    id: Name
    """Name of the device in the configuration."""
    state: Literal["starting", "ready", "lost", "failed", "stopped"]
    """As in the status message."""
    rate_hz: NotNegative
    """Samples received per second since the previous health message."""
    age_s: NotNegative | None
    """Time since the last bytes of the device; null if never."""
    queued: Count
    """Items waiting between the reader thread and the pipeline."""
    queue_limit: Count
    """So many may wait."""
    counters: dict[Word, Count]
    """Names from the table of counters."""
    temperatures_c: dict[Name, float]
    """The device's own sensors, by name; those without a reading are left out."""


class Health(Message):
    """Counters, rates, latencies, temperatures, broker and devices."""

    schema_: Literal["traverse/health/1"] = schema_field("traverse/health/1")
    arm: ArmName
    """Name of the arm."""
    session: Name | None
    """Session that new points belong to; null before the first."""
    time_ns: TimeNs
    """When the figures were taken. [UTC]"""
    uptime_s: NotNegative
    """Time since the daemon's start."""
    kernel: Word
    """Kinematic computation: "numpy", or "portable", "avx2", "avx512" in C."""
    cpu_share: NotNegative
    """CPU time over elapsed time since the previous message; 1 is one core."""
    rss_bytes: Count
    """Resident memory."""
    counters: dict[Word, Count]
    """Since the daemon's start; names from the table of counters."""
    rates_hz: dict[Word, NotNegative]
    """Increase per second of counters of the same name since the previous message."""
    latencies: dict[Word, Latency]
    """Names from the table of latencies."""
    temperatures_c: dict[Name, float]
    """Temperatures used by the corrections: "arm", or a joint's name."""
    skew_mm: NotNegative | None
    """Largest error of position that reading the joints at different instants may have
    left since the previous message; null where they are all read at one instant."""
    broker: BrokerHealth
    """The connection to the broker."""
    outbox: OutboxHealth
    """The points on disk."""
    spool: SpoolHealth | None
    """The scans on disk; null while none has been stored."""
    recording: RecordingHealth
    """Recordings on disk."""
    devices: Annotated[tuple[DeviceHealth, ...], Field(max_length=64, fail_fast=True)]
    """All configured devices."""

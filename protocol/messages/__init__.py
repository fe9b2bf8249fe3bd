"""All messages that travel over MQTT, defined once, here."""

from traverse.protocol.messages.clock import Clock, Expiry
from traverse.protocol.messages.commands import (
    COMMANDS,
    AlignArgs,
    Args,
    Command,
    CovarianceArgs,
    HomeArgs,
    LabelArgs,
    PointArgs,
    ProbeArgs,
    Reading,
    RecordArgs,
    ReferenceArgs,
    ReloadArgs,
    ResendArgs,
    ScanArgs,
    SessionArgs,
    UndoArgs,
)
from traverse.protocol.messages.event import Event
from traverse.protocol.messages.fields import Message, Value
from traverse.protocol.messages.health import (
    COUNTERS,
    LATENCIES,
    BrokerHealth,
    DeviceHealth,
    Health,
    Latency,
    OutboxHealth,
    RecordingHealth,
    SpoolHealth,
)
from traverse.protocol.messages.live import Live
from traverse.protocol.messages.point import Label, Point
from traverse.protocol.messages.quality import (
    FLAG_MEANINGS,
    REMARKS,
    Quality,
    QualityFlag,
    flag_names,
)
from traverse.protocol.messages.reply import Reply, ReplyError
from traverse.protocol.messages.scan import Scan
from traverse.protocol.messages.status import (
    Alarm,
    ConditionStanding,
    DriverStatus,
    Status,
)

MESSAGES: tuple[type[Message], ...] = (
    Status,
    Point,
    Scan,
    Live,
    Event,
    Health,
    Clock,
    Command,
    Reply,
)
"""Every message; their schemas are those of MESSAGES and no others."""

"""One example of every message, kept as golden files in both encodings.

`python -m tests.protocol.message_examples` writes the files anew after a message has
been changed on purpose; the diff is then to be read byte by byte.
"""

import json
from pathlib import Path

import numpy as np

from traverse.protocol.encoding import encode
from traverse.protocol.messages import (
    Alarm,
    AlignArgs,
    BrokerHealth,
    Clock,
    Command,
    ConditionStanding,
    CovarianceArgs,
    DeviceHealth,
    DriverStatus,
    Event,
    Expiry,
    Health,
    HomeArgs,
    Label,
    LabelArgs,
    Latency,
    Live,
    Message,
    OutboxHealth,
    Point,
    PointArgs,
    ProbeArgs,
    Quality,
    RecordArgs,
    RecordingHealth,
    ReferenceArgs,
    ReloadArgs,
    Reply,
    ReplyError,
    ResendArgs,
    Scan,
    ScanArgs,
    SessionArgs,
    SpoolHealth,
    Status,
    UndoArgs,
)
from traverse.protocol.messages.later_doubt import LaterDoubt

GOLDEN = Path(__file__).parent / "golden"
ARM = "bench-7"
MODEL = "sha256:" + "9f86d081884c7d65" * 4
SESSION = "20261121-080012-4f1a"
TIME_NS = 1795251247123456789

STATUS = Status(
    online=True,
    state="degraded",
    arm=ARM,
    model=MODEL,
    version="0.1.0",
    kernel="numpy",
    encoding="msgpack",
    session=SESSION,
    time_ns=TIME_NS,
    drivers=(
        DriverStatus(
            id="base",
            driver="latch-board",
            port="/dev/ttyACM0",
            state="ready",
            identity={"board_id": "0102030405060708090a0b0c", "firmware": "1.4.0"},
        ),
        DriverStatus(
            id="wrist",
            driver="latch-board",
            port="/dev/ttyACM1",
            state="lost",
            identity={},
        ),
    ),
    alarms=(
        Alarm(
            severity="error",
            code="device.lost",
            source="wrist",
            text="port has gone",
            remedy="check the cable",
            since_ns=TIME_NS,
        ),
    ),
    conditions=(
        ConditionStanding(
            name="reference",
            source="base",
            established=False,
            since_ns=TIME_NS,
            cause="base has been without power",
            remedy="touch a point that you know, then confirm",
            command="reference",
        ),
    ),
    doubts=(
        LaterDoubt(
            points=("4f1a-9",),
            from_ns=TIME_NS - 2 * 10**9,
            until_ns=TIME_NS - 10**9,
            flags=("turns_uncertain",),
        ),
    ),
    probe="ball-6",
    probes=("ball-6", "star-left"),
    label=Label(artefact="plate"),
    alignment="vice",
)
LAST_WILL = Status(
    online=False,
    state="offline",
    arm=ARM,
    model=None,
    version="0.1.0",
    kernel="numpy",
    encoding="json",
    session=None,
    time_ns=TIME_NS,
    drivers=(),
)
POINT = Point(
    session=SESSION,
    seq=17,
    id="4f1a-17",
    retracts=None,
    arm=ARM,
    model=MODEL,
    trigger="button",
    time_ns=TIME_NS,
    time_bound_ns=412_000,
    xyz_mm=(612.25, -80.5, 301.125),
    ijk=(0.6, 0.0, -0.8),
    surface_mm=(614.05, -80.5, 298.725),
    compensation="shank",
    part_xyz_mm=None,
    covariance_mm2=(1e-4, 0.0, 2e-5, 1.5e-4, 0.0, 2.25e-4),
    angles_rad=(0.1, -0.5, 1.25, 0.0, 2.5, -1.75, 3.0),
    counts=(133502, -667510, 1668776, 0, 3337552, -2336286, 4005062),
    temperature_c=20.5,
    probe_radius_mm=3.0,
    samples=25,
    spread_mm=0.0042,
    label=Label(artefact="bar", feature="1"),
    quality=Quality.from_bits(1 << 5 | 1 << 15),
)
RETRACTION = POINT.retraction(
    seq=18, point_id="4f1a-18", trigger="command", time_ns=TIME_NS + 2_000_000_000
)
SCAN = Scan(
    session=SESSION,
    scan="scan-3",
    seq=1000,
    arm=ARM,
    model=MODEL,
    mode="time",
    rate_hz=1000.0,
    probe_radius_mm=3.0,
    time_ns=TIME_NS,
    dtime_ns=np.array([0, 1_000_000]),
    xyz_mm=np.array([[612.25, -80.5, 301.125], [612.5, -80.5, 301.125]]),
    ijk=np.array([[0.6, 0.0, -0.8], [0.6, 0.0, -0.8]]),
    angles_rad=np.array([[0.125, -0.5], [0.25, -0.5]]),
    counts=np.array([[166886, -667544], [333772, -667544]]),
    part_xyz_mm=None,
    covariance_mm2=np.array([[1e-4, 0, 0, 1e-4, 0, 4e-4]] * 2),
    quality=np.array([0, 1 << 5], np.uint32),
    dropped=0,
    lost=1,
    last=True,
    total=1002,
    in_doubt=161,
)
LIVE = Live(
    arm=ARM,
    model=MODEL,
    session=SESSION,
    time_ns=TIME_NS,
    xyz_mm=(612.25, -80.5, 301.125),
    ijk=(0.6, 0.0, -0.8),
    part_xyz_mm=(12.25, 19.5, 1.125),
    covariance_mm2=None,
    angles_rad=(0.125, -0.5),
    skeleton_mm=((0.0, 0.0, 0.0), (0.0, 0.0, 250.0), (612.25, -80.5, 301.125)),
    speed_mm_s=42.5,
    probe_radius_mm=3.0,
    inputs=("base/0",),
    quality=Quality(ok=True, flags=()),
)
EVENT = Event(
    arm=ARM,
    session=None,
    severity="error",
    code="device.lost",
    text="base: the port closed",
    remedy="Check the cable.",
    source="base",
    active=True,
    first_ns=TIME_NS,
    last_ns=TIME_NS + 1,
    count=2,
    data={"silence_s": 0.5},
)
HEALTH = Health(
    arm=ARM,
    session=SESSION,
    time_ns=TIME_NS,
    uptime_s=3600.5,
    kernel="numpy",
    cpu_share=0.125,
    rss_bytes=73_400_320,
    counters={"samples_received": 3_600_000, "samples_lost": 1, "points_captured": 18},
    rates_hz={"samples_received": 1000.0},
    latencies={
        "capture_to_publish": Latency(
            p50_us=180.0,
            p99_us=450.0,
            max_us=900.0,
            n=18,
            histogram=(0, 0, 0, 2, 8, 7, 1, *(0,) * 12),
        )
    },
    temperatures_c={"arm": 20.5},
    skew_mm=0.004,
    broker=BrokerHealth(
        state="connected",
        host="localhost",
        port=1883,
        reconnects=0,
        queued=0,
        queue_limit=10_000,
        unacknowledged=1,
        dropped=0,
    ),
    outbox=OutboxHealth(
        state="ready",
        points=120_000,
        unsent=1,
        bytes=104_857_600,
        oldest_unsent_ns=TIME_NS,
    ),
    spool=SpoolHealth(state="ready", blocks=72_000, unsent=20, bytes=760_217_600),
    recording=RecordingHealth(
        state="recording",
        name="bumps",
        bytes=1_048_576,
        flight_bytes=9_437_184,
        queued=3,
        dropped=0,
        kept=1,
        kept_dropped=0,
    ),
    devices=(
        DeviceHealth(
            id="base",
            state="ready",
            rate_hz=1000.0,
            age_s=0.001,
            queued=0,
            queue_limit=4096,
            counters={"frames_received": 3_600_120, "frames_rejected": 1},
            temperatures_c={"0": 20.5},
        ),
    ),
)
REPLY = Reply(request="r-1", ok=True, result={"seq": 17})
REFUSAL = Reply(
    request="r-1",
    ok=False,
    error=ReplyError(
        code="command.bad_args",
        text="rate_hz: 0; expected above 0",
        remedy="Give a rate.",
    ),
)

ARGS = (
    PointArgs(samples=25),
    ScanArgs(action="start", mode="time", rate_hz=1000.0),
    UndoArgs(id="4f1a-17"),
    LabelArgs(artefact="bar", feature="1"),
    ProbeArgs(name="ruby-6"),
    ReferenceArgs(action="confirm", at_xyz_mm=(1.0, 2.0, 3.0)),
    HomeArgs(joints=("J1", "J2")),
    ReloadArgs(),
    AlignArgs(
        action="set",
        name="fixture",
        rotation=((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        translation_mm=(100.0, -20.0, 0.0),
    ),
    SessionArgs(action="new", note="second shift"),
    ResendArgs(session=SESSION, from_seq=3, to_seq=9),
    RecordArgs(action="start", name="bumps", note="somebody leans on the table"),
    CovarianceArgs(ids=("4f1a-17", "4f1a-18")),
)

CLOCK = Clock(
    arm="bench-7", clock="5b1c0a52e7f94c5fa1d3c1a4b7b0e0c1", now_ns=86_400_123_456_789
)
EXPIRES = Expiry(clock=CLOCK.clock, at_ns=CLOCK.now_ns + 5_000_000_000)

EXAMPLES: dict[str, Message] = {
    "status": STATUS,
    "status-offline": LAST_WILL,
    "point": POINT,
    "point-retraction": RETRACTION,
    "scan": SCAN,
    "live": LIVE,
    "event": EVENT,
    "health": HEALTH,
    "clock": CLOCK,
    **{
        f"command-{args.command}": Command.carrying(args, "r-1", EXPIRES)
        for args in ARGS
    },
    "reply": REPLY,
    "reply-error": REFUSAL,
}


def json_text(message: Message) -> str:
    values = json.loads(encode(message, "json"))
    lines = (f"  {json.dumps(key)}: {json.dumps(values[key])}" for key in values)
    return "{\n" + ",\n".join(lines) + "\n}\n"


def hex_text(payload: bytes) -> str:
    rows = (payload[i : i + 24] for i in range(0, len(payload), 24))
    return "".join(row.hex(" ").upper() + "\n" for row in rows)


if __name__ == "__main__":
    for name, example in EXAMPLES.items():
        (GOLDEN / f"{name}.json").write_text(json_text(example))
        packed = encode(example, "msgpack")
        (GOLDEN / f"{name}.msgpack.hex").write_text(hex_text(packed))

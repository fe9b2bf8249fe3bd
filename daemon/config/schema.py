"""The daemon's configuration file: strict TOML; all mistakes are reported at once.

Every key is explained in docs/reference/configuration.md.
"""

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, field_validator, model_validator

from traverse.daemon.config.devices import AnyDevice
from traverse.daemon.config.filters import AnyFilter, flag_bits
from traverse.protocol import topics
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages.point import Compensation
from traverse.strict_toml.problems import (
    FileError,
    Problem,
    tables_in,
    toml_table,
    toml_text,
)
from traverse.strict_toml.reader import StrictModel, parse_strict

TLS_PORT = 8883

FileName = Annotated[str, Field(min_length=1, max_length=4096)]


class BrokerSection(StrictModel):
    """Broker and credentials.

    Verification of the broker's certificate cannot be switched off.
    """

    host: str = Field(default="localhost", min_length=1, max_length=253)
    port: int = Field(default=1883, ge=1, le=65535)
    username: str | None = Field(default=None, min_length=1, max_length=256)
    password_file: FileName | None = None
    tls: bool = False
    ca_file: FileName | None = None
    certificate_file: FileName | None = None
    key_file: FileName | None = None
    response_topics: Annotated[tuple[str, ...], Field(max_length=16)] = ()
    keepalive_s: int = Field(default=15, ge=1, le=600)
    encoding: Literal["msgpack", "json"] = "msgpack"

    @model_validator(mode="before")
    @classmethod
    def _default_tls_port(cls, raw: object) -> object:
        if isinstance(raw, Mapping) and raw.get("tls") is True and "port" not in raw:
            return {**raw, "port": TLS_PORT}
        return raw


def broker_table_problems(raw: object) -> Iterator[Problem]:
    if not isinstance(raw, Mapping):
        return
    if raw.get("tls") is not True:
        for key in ("ca_file", "certificate_file", "key_file"):
            if key in raw:
                text = "is given without tls = true; the line would not be encrypted"
                yield Problem(f"broker.{key}", text)
    for key, other in (
        ("certificate_file", "key_file"),
        ("key_file", "certificate_file"),
    ):
        if key in raw and other not in raw:
            text = f"is missing; {key} is given, and the two belong together"
            yield Problem(f"broker.{other}", text)
    if "password_file" in raw and "username" not in raw:
        text = "is missing; password_file is given, and a password needs a name"
        yield Problem(".".join(("broker", "username")), text)
    yield from _filter_problems(raw.get("response_topics"))


def _filter_problems(filters: Any) -> Iterator[Problem]:  # noqa: ANN401 - of a file
    """Find invalid filters, and those that admit topics of arms."""
    if not isinstance(filters, list):
        return
    for index, topic_filter in enumerate(filters):
        if not isinstance(topic_filter, str):
            continue
        try:
            topics.check_response_filter(topic_filter)
        except MessageError as error:
            yield Problem(f"broker.response_topics[{index}]", str(error))


class MetricsSection(StrictModel):
    """Metrics endpoint; none without a port."""

    port: int | None = Field(default=None, ge=1, le=65535)
    host: str = Field(default="127.0.0.1", min_length=1)


class OutboxSection(StrictModel):
    """Retention of points that the broker has."""

    keep_days: float = Field(default=90.0, gt=0.0, le=36_500.0)
    keep_mb: float = Field(default=1000.0, ge=1.0, le=1_000_000.0)


MAX_PRIORITY = 98  # 99 is the kernel's own threads'


class RealtimeSection(StrictModel):
    """Real-time requests to the system; refusals are reported."""

    priority: int = Field(default=0, ge=0, le=MAX_PRIORITY)
    lock_memory: bool = False
    cpus: Annotated[tuple[int, ...], Field(max_length=64)] = ()

    @field_validator("cpus")
    @classmethod
    def _check_cpus(cls, cpus: tuple[int, ...]) -> tuple[int, ...]:
        available = sorted(os.sched_getaffinity(0))
        if missing := [cpu for cpu in cpus if cpu not in available]:
            allowed = ", ".join(map(str, available))
            message = f"the daemon may use the CPUs {allowed}, not {missing}"
            raise ValueError(message)
        return cpus


class RecordingSection(StrictModel):
    """Recordings: which, how many are kept, how safely."""

    flight: bool = True
    flight_s: float = Field(default=60.0, ge=20.0, le=3600.0)
    flight_mb: int = Field(default=64, ge=4, le=100_000)
    kept: int = Field(default=10, ge=1, le=1000)
    flush_s: float = Field(default=1.0, ge=0.1, le=10.0)
    sync: bool = False
    min_free_mb: int = Field(default=500, ge=10, le=1_000_000)
    max_mb: int = Field(default=20_000, ge=10, le=1_000_000)


MOST_STOP_RAD = 8.0 * math.pi  # of a joint that has stops at all


class EndStopSection(StrictModel):
    """End stops of a joint."""

    joint: str = Field(min_length=1)
    low_rad: float
    high_rad: float
    margin_rad: float = Field(default=0.035, ge=0.0, le=3.2)

    @model_validator(mode="after")
    def _has_range(self) -> Self:
        if self.high_rad - self.low_rad <= 2.0 * self.margin_rad:
            text = (
                f"low_rad {self.low_rad:g} and high_rad {self.high_rad:g}: nothing is "
                f"left between margins of {self.margin_rad:g}; correct them"
            )
            raise ValueError(text)
        if max(abs(self.low_rad), abs(self.high_rad)) > MOST_STOP_RAD:
            text = (
                f"low_rad {self.low_rad:g} and high_rad {self.high_rad:g} are beyond "
                f"four turns, {MOST_STOP_RAD:.1f} rad: degrees? Such stops would be "
                "reached by no joint; give radians, or leave them out"
            )
            raise ValueError(text)
        return self


class QualitySection(StrictModel):
    """Quality limits; absent ones are not checked."""

    end_stops: Annotated[tuple[EndStopSection, ...], Field(max_length=64)] = ()
    singular_ratio: float | None = Field(default=None, gt=0.0, lt=1.0)
    overspeed_mm_s: float | None = Field(default=None, gt=0.0)
    temperature_low_c: float | None = Field(default=None, ge=-273.15)
    temperature_high_c: float | None = None
    temperature_change_c: float | None = Field(default=3.0, gt=0.0)
    temperature_time_s: float = Field(default=300.0, ge=1.0, le=86_400.0)
    identification_days: float | None = Field(default=None, gt=0.0)
    refuse: Annotated[tuple[str, ...], Field(max_length=32)] = ("encoder_error",)
    assumed_devices: Annotated[tuple[str, ...], Field(max_length=64)] = ()

    @field_validator("refuse")
    @classmethod
    def _check_flags(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        flag_bits(names)
        return names

    @model_validator(mode="after")
    def _check_band(self) -> Self:
        low_c, high_c = self.temperature_low_c, self.temperature_high_c
        if low_c is not None and high_c is not None and low_c >= high_c:
            text = f"temperature_low_c {low_c:g} below temperature_high_c {high_c:g}"
            raise ValueError(text)
        return self


class ScanSection(StrictModel):
    """Defaults and filters of scans."""

    rate_hz: float = Field(default=100.0, gt=0.0, le=10_000.0)
    dense_rate_hz: float = Field(default=1000.0, ge=10.0, le=10_000.0)
    held_wait_s: float = Field(default=0.2, ge=0.01, le=2.0)
    delivery: Literal["live", "complete"] = "live"
    spool_mb: float = Field(default=1000.0, ge=2.0, le=1_000_000.0)
    spool_days: float = Field(default=7.0, gt=0.0, le=36_500.0)
    filters: Annotated[tuple[AnyFilter, ...], Field(max_length=32)] = ()


Action = Literal["point", "average", "undo", "scan", "stop", "session", "air", "none"]
INPUT_PATTERN = r"^[A-Za-z0-9_-]+/[0-7]$"


class ArmSection(StrictModel):
    """The arm."""

    file: str = Field(min_length=1)
    probes: str | None = None


class InputSection(StrictModel):
    """Meaning of a digital input."""

    source: str = Field(pattern=INPUT_PATTERN)
    trigger: Literal["button", "switch"]
    normally_closed: bool = False
    click: Action = "point"
    double: Action | None = None
    hold: Action | None = None
    long: Action | None = None

    @property
    def gesture_actions(self) -> dict[str, Action]:
        actions = {"click": self.click, "double": self.double, "hold": self.hold}
        actions["long"] = self.long
        return {name: action for name, action in actions.items() if action is not None}

    @property
    def device_id(self) -> str:
        return self.source.partition("/")[0]

    @property
    def number(self) -> int:
        return int(self.source.partition("/")[2])


class CaptureSection(StrictModel):
    """How points are captured."""

    tracking_rate_hz: float = Field(default=100.0, ge=10.0, le=1000.0)
    live_rate_hz: float = Field(default=20.0, gt=0.0, le=100.0)
    scan_block_s: float = Field(default=0.05, ge=0.01, le=1.0)
    scan_max_rate_hz: float = Field(default=10_000.0, gt=0.0, le=10_000.0)
    hold_s: float = Field(default=0.4, ge=0.1, le=5.0)
    long_s: float = Field(default=1.0, ge=0.1, le=5.0)
    double_s: float = Field(default=0.3, ge=0.05, le=2.0)
    compensation: Compensation = "shank"
    middle_mm: tuple[float, float, float] | None = None
    pretouch_mm: float = Field(default=2.0, ge=0.2, le=100.0)
    pull_mm: float = Field(default=2.0, ge=0.2, le=100.0)
    pull_s: float = Field(default=1.0, ge=0.1, le=10.0)
    average_s: float = Field(default=0.5, ge=0.01, le=10.0)
    average_speed_mm_s: float = Field(default=5.0, gt=0.0, le=1000.0)
    average_spread_mm: float = Field(default=0.05, gt=0.0, le=100.0)
    max_waiting_points: int = Field(default=1000, ge=1, le=100_000)
    inputs: Annotated[tuple[InputSection, ...], Field(max_length=64)] = ()


class AssemblySection(StrictModel):
    """How readings of different instants become samples."""

    clock: str | None = None
    wait_s: float = Field(default=0.05, ge=0.001, le=1.0)
    point_wait_s: float = Field(default=0.5, ge=0.01, le=5.0)
    policy: Literal["flag", "drop"] = "flag"
    skew_limit_mm: float = Field(default=0.1, gt=0.0)


class UncertaintySection(StrictModel):
    """Standard deviations that no other file states."""

    encoder_rad: float = Field(default=5e-6, ge=0.0, le=0.01)
    contact_mm: float = Field(default=0.005, ge=0.0, le=10.0)
    trigger_s: float = Field(default=1e-5, ge=0.0, le=1.0)


class HealthSection(StrictModel):
    """Health messages."""

    period_s: float = Field(default=2.0, ge=0.2, le=3600.0)


class SigningSection(StrictModel):
    """Key for signing points; without it they are not signed."""

    key: str | None = Field(default=None, min_length=1)


class Configuration(StrictModel):
    """The whole file."""

    arm: ArmSection
    broker: BrokerSection | None = None
    device: Annotated[tuple[AnyDevice, ...], Field(min_length=1)]
    capture: CaptureSection = CaptureSection()
    scan: ScanSection = ScanSection()
    quality: QualitySection = QualitySection()
    assembly: AssemblySection = AssemblySection()
    uncertainty: UncertaintySection = UncertaintySection()
    health: HealthSection = HealthSection()
    metrics: MetricsSection = MetricsSection()
    realtime: RealtimeSection = RealtimeSection()
    recording: RecordingSection = RecordingSection()
    outbox: OutboxSection = OutboxSection()
    signing: SigningSection = SigningSection()


def read_configuration(path: Path) -> Configuration:
    """Read and check a configuration file.

    Raises:
        FileError: lists all mistakes.
    """
    text = toml_text(path)
    kind = toml_table(text, str(path)).get("schema")
    if isinstance(kind, str):
        expected = (
            "a daemon's configuration, which names the arm file as `file` in [arm]"
            if kind.startswith("traverse/arm/")
            else "a daemon's configuration, which has no key `schema`"
        )
        raise FileError(
            path, [Problem("schema", f"this is a file {kind!r}; expected {expected}")]
        )
    return parse_strict(text, str(path), Configuration, _cross_check)


def _cross_check(raw: Mapping[str, Any]) -> Iterator[Problem]:
    ids: dict[str, int] = {}
    for index, device in enumerate(tables_in(raw.get("device"))):
        name = device.get("id")
        if not isinstance(name, str):
            continue
        if name in ids:
            yield Problem(
                f"device[{index}].id",
                f"{name!r} is also the id of device[{ids[name]}]; ids are unique",
            )
        ids.setdefault(name, index)
    yield from broker_table_problems(raw.get("broker"))
    capture = raw.get("capture")
    if isinstance(capture, Mapping):
        method = capture.get("compensation")
        if method in ("inside", "outside") and "middle_mm" not in capture:
            text = f"is missing; compensation {method!r} needs a point in the middle"
            yield Problem(".".join(("capture", "middle_mm")), text)
    quality = raw.get("quality")
    assumed = quality.get("assumed_devices") if isinstance(quality, Mapping) else None
    for index, name in enumerate(assumed if isinstance(assumed, list) else ()):
        if name not in ids:
            yield _unknown_device(f"quality.assumed_devices[{index}]", name, ids)
    seen: set[str] = set()
    inputs = capture.get("inputs") if isinstance(capture, Mapping) else None
    for index, table in enumerate(tables_in(inputs)):
        source = table.get("source")
        if not isinstance(source, str):
            continue
        where = f"capture.inputs[{index}].source"
        if source.partition("/")[0] not in ids:
            yield _unknown_device(where, source, ids)
        if source in seen:
            yield Problem(where, f"{source!r} is given twice")
        seen.add(source)
        yield from _gesture_problems(index, table)


def _unknown_device(where: str, name: object, ids: Iterable[str]) -> Problem:
    known = ", ".join(sorted(ids)) or "none"
    return Problem(where, f"{name!r} names no device; there are: {known}")


def _gesture_problems(index: int, table: Mapping[str, Any]) -> Iterator[Problem]:
    where = f"capture.inputs[{index}]"
    if "hold" in table and "long" in table:
        text = "cannot be combined with hold: both begin with a long press; use one"
        yield Problem(f"{where}.long", text)
    if table.get("trigger") == "switch":
        for name in {"double", "hold", "long"} & set(table):
            text = "is a gesture of a hand; a switching probe has click alone"
            yield Problem(f"{where}.{name}", text)

"""The daemon's configuration file: strict TOML, all mistakes at once.

Every key is explained in docs/reference/configuration.md.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from traverse.daemon.config.broker import BrokerSection, broker_table_problems
from traverse.daemon.config.devices import AnyDevice
from traverse.daemon.config.metrics import MetricsSection
from traverse.daemon.config.outbox import OutboxSection
from traverse.daemon.config.quality import QualitySection
from traverse.daemon.config.realtime import RealtimeSection
from traverse.daemon.config.recording import RecordingSection
from traverse.daemon.config.scan import ScanSection
from traverse.kinematics.arm_file.arm import Problem, StrictModel, read_strict
from traverse.protocol.messages.point import Compensation

Action = Literal["point", "average", "undo", "scan", "stop", "session", "air", "none"]
INPUT_PATTERN = r"^[A-Za-z0-9_-]+/[0-7]$"


class ArmSection(StrictModel):
    """Which arm this is."""

    file: str = Field(min_length=1)
    probes: str | None = None


class InputSection(StrictModel):
    """What a digital input of a device means."""

    source: str = Field(pattern=INPUT_PATTERN)
    trigger: Literal["button", "switch"]
    click: Action = "point"
    double: Action | None = None
    hold: Action | None = None
    long: Action | None = None

    @property
    def meanings(self) -> dict[str, Action]:
        """What its gestures do, those that do anything."""
        told = {"click": self.click, "double": self.double, "hold": self.hold}
        told["long"] = self.long
        return {name: action for name, action in told.items() if action is not None}

    @property
    def device_id(self) -> str:
        """The device it belongs to."""
        return self.source.partition("/")[0]

    @property
    def number(self) -> int:
        """Its number on the device."""
        return int(self.source.partition("/")[2])


class CaptureSection(StrictModel):
    """How samples become points."""

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
    """How readings of different instants become samples of the arm."""

    clock: str | None = None
    wait_s: float = Field(default=0.05, ge=0.001, le=1.0)
    point_wait_s: float = Field(default=0.5, ge=0.01, le=5.0)
    policy: Literal["flag", "drop"] = "flag"
    skew_limit_mm: float = Field(default=0.1, gt=0.0)


class UncertaintySection(StrictModel):
    """Standard deviations that no other file tells."""

    encoder_rad: float = Field(default=5e-6, ge=0.0, le=0.01)
    contact_mm: float = Field(default=0.005, ge=0.0, le=10.0)
    trigger_s: float = Field(default=1e-5, ge=0.0, le=1.0)


class HealthSection(StrictModel):
    """How often the daemon says how it is."""

    period_s: float = Field(default=2.0, ge=0.2, le=3600.0)


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


def read_configuration(path: Path) -> Configuration:
    """Read and check a configuration file.

    Raises:
        FileError: with everything that is wrong with it.
    """
    return read_strict(path, Configuration, _cross_check)


def _cross_check(raw: Mapping[str, Any]) -> Iterator[Problem]:
    ids: dict[str, int] = {}
    for index, device in enumerate(_tables(raw, "device")):
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
    seen: set[str] = set()
    inputs = _tables(capture, "inputs") if isinstance(capture, Mapping) else []
    for index, table in enumerate(inputs):
        source = table.get("source")
        if not isinstance(source, str):
            continue
        where = f"capture.inputs[{index}].source"
        if source.partition("/")[0] not in ids:
            known = ", ".join(sorted(ids)) or "none"
            yield Problem(where, f"{source!r} names no device; there are: {known}")
        if source in seen:
            yield Problem(where, f"{source!r} is given twice")
        seen.add(source)
        yield from _gesture_problems(index, table)


def _gesture_problems(index: int, table: Mapping[str, Any]) -> Iterator[Problem]:
    """Gestures of one input that cannot be told apart, or make no sense."""
    where = f"capture.inputs[{index}]"
    if "hold" in table and "long" in table:
        text = "is given beside hold; both begin with a press that goes on, take one"
        yield Problem(f"{where}.long", text)
    if table.get("trigger") == "switch":
        for name in {"double", "hold", "long"} & set(table):
            text = "is a gesture of a hand; a switching probe has click alone"
            yield Problem(f"{where}.{name}", text)


def _tables(raw: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    value = raw.get(key)
    if not isinstance(value, list):
        return []
    return [item if isinstance(item, Mapping) else {} for item in value]

"""Clocks, arms and samples that the tests of the daemon share."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from tests.arm_files import arm_text, joint_text
from tests.established import identify
from traverse.daemon.clock import HostClock
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.config.schema import (
    ArmSection,
    CaptureSection,
    Configuration,
    InputSection,
)
from traverse.daemon.pose.arm_model import ArmModel, read_model
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.pose.published import PublishedNumbers
from traverse.daemon.store.records import PendingPoint
from traverse.drivers.base.values import CountSamples, LatchedCounts
from traverse.protocol.messages import Point

UTC_OFFSET_NS = 1_700_000_000_000_000_000
NOTHING_PUBLISHED = PublishedNumbers(lambda ns: ns, lambda ns: [])
DEVICES = {"base": None, "wrist": None}
MODULI = (1 << 32, 1 << 23, 1 << 20)

# Three joints on channels 2, 0 and 1 of a board; one of them turns the other way.
ARM = arm_text(
    "bench-7",
    joint_text("J1", [0.0, 0.0, 2.0], [0.0, 10.0, 250.0], 1.234, (65536, 1, "base/2")),
    joint_text("J2", [0.0, 1.0, 0.0], [0.0, 0.0, 300.0], -0.5, (1 << 20, -1, "base/0")),
    joint_text("J3", [1.0, 0.0, 0.0], [0.0, 20.0, 200.0], 0.25, (1 << 23, 1, "base/1")),
    origin_mm=[1.0, -2.0, 3.5],
    probe='radius_mm = 3.0\nkind = "hard"\nvector_mm = [0.0, 0.0, 50.0]\n'
    "direction = [0.0, 0.0, 1.0]",
)


class SetClock(HostClock):
    def __init__(self) -> None:
        self.now_ns = 10**12
        self.offset_ns = UTC_OFFSET_NS

    def monotonic_ns(self) -> int:
        return self.now_ns

    def utc_offset_ns(self) -> int:
        return self.offset_ns


def kept_at_once(take: Callable[[Point], bool]):
    def keep(point: Point, begun_ns: int, note: str) -> PendingPoint | None:
        if not take(point):
            return None
        keeping = PendingPoint(point)
        keeping.settle()
        return keeping

    return keep


def configuration(*devices: str, inputs=None, capture=None, **sections):
    """Of latch boards with these ids; ``inputs`` are added to those of ``capture``."""
    capture = dict(capture or {})
    given = capture.get("inputs", ())
    capture["inputs"] = given + tuple(
        InputSection(source=source, trigger=trigger)
        for source, trigger in (inputs or {}).items()
        if source not in {device.source for device in given}
    )
    return Configuration(
        arm=ArmSection(file="arm.toml"),
        device=tuple(
            DeviceSection.from_table(
                {"id": name, "driver": "latch-board", "port": "/dev/null"}
            )
            for name in devices
        ),
        capture=CaptureSection(**capture),
        **sections,
    )


def arm_file(folder: Path, text: str = ARM) -> Path:
    path = folder / "arm.toml"
    path.write_text(text)
    return path


def arm_model(folder: Path, text: str = ARM) -> ArmModel:
    path = arm_file(folder, text)
    return read_model(path if "covariance_file" in text else identify(path), DEVICES)


def count_samples(
    counts: np.ndarray, *, first: int = 0, stream: int = 1, start_ns: int = 10**12
) -> CountSamples:
    """Samples of (n, n_channels) counts, 10 ms apart."""
    n = len(counts)
    seq = np.arange(first, first + n, dtype=np.int64)
    times_ns = start_ns + seq * 10_000_000
    return CountSamples(
        "base",
        stream,
        seq,
        times_ns // 1000,
        int(times_ns[-1]) + 1_000_000,
        times_ns,
        np.zeros(n, np.uint8),
        counts.astype(np.uint32),
        np.zeros(counts.shape, np.uint8),
    )


def latch(
    counts: tuple[int, ...],
    *,
    number: int | None = 0,
    active: bool = True,
    token: int = 0,
    status: tuple[int, ...] | None = None,
    now_ns: int = 10**12,
) -> LatchedCounts:
    return LatchedCounts(
        "base",
        number,
        active,
        token,
        now_ns // 1000,
        now_ns,
        now_ns - 400_000,
        counts,
        (0,) * len(counts) if status is None else status,
    )


@dataclass(frozen=True)
class PoseMaker:
    """Blocks of poses whose coordinates encode their sampling instant."""

    model: ArmModel
    period_ns: int
    start_ns: int = 10**12

    def block(
        self, seq: list[int] | range, *, stream: int = 1, at: int | None = None
    ) -> PoseBlock:
        """Poses numbered ``seq``; the first was latched at instant ``at``."""
        numbers = np.array(seq, dtype=np.int64)
        instants = numbers if at is None else numbers - numbers[0] + at
        n, joints = len(numbers), self.model.encoders.n_joints
        return PoseBlock(
            stream,
            numbers,
            self.start_ns + instants * self.period_ns,
            self.start_ns,
            np.zeros(n, np.uint8),
            np.zeros((n, joints), np.int64),
            np.zeros((n, joints)),
            np.repeat(instants[:, np.newaxis].astype(float), 3, axis=1),
            np.tile([0.0, 0.0, 1.0], (n, 1)),
            np.zeros(n, np.uint32),
        )


def joined_poses(blocks: list[PoseBlock]) -> PoseBlock:
    columns = {
        field.name: np.concatenate([getattr(block, field.name) for block in blocks])
        for field in fields(PoseBlock)
        if field.name not in ("stream", "received_ns", "time_bound_ns")
    }
    return replace(blocks[-1], **columns)

"""The path with the classes of the daemon, whole and cut into its stages."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from benchmarks.path.line import TICKS, cut
from benchmarks.tools.rounds import Task
from traverse.arrays import Floats
from traverse.daemon.clock import HostClock
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.scans.plan import plan_scan
from traverse.daemon.scans.scanner import Scanner, ScanSink
from traverse.drivers.base.values import CountSamples
from traverse.drivers.latch_board.sequences import StreamSequence
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.readings import Unwrapper, counts_to_angles
from traverse.protocol.encoding import encode
from traverse.protocol.latch_board.framing import FrameSplitter
from traverse.protocol.latch_board.messages import Decoder, SampleBlock
from traverse.protocol.messages import Scan

BLOCK_S = 0.05  # default span of one message


@dataclass(frozen=True, slots=True)
class Delivery:
    """How bytes are delivered: bytes of a read, and of a turn of the event loop."""

    name: str
    read_bytes: int
    reads: int


FROM_MEMORY = Delivery("reads of 64 KiB", 65_536, 1)
LIKE_A_LINE = Delivery("reads of 2 ms, taken up every 20 ms", 940, 10)


class Timing:
    """Numbers and times of samples, as assigned by the driver."""

    def __init__(self) -> None:
        self._sequence = StreamSequence()
        self._clock = DeviceClock(TICKS)

    def samples(self, block: SampleBlock) -> CountSamples:
        """A block with its times; received when its last sample was latched."""
        seq, _, _, _ = self._sequence.accept(block.seq)
        ticks = self._clock.unwrap(block.ticks)
        received_ns = int(ticks[-1]) * 1000
        self._clock.update(int(ticks[-1]), received_ns)
        return CountSamples(
            "base",
            1,
            seq,
            ticks,
            received_ns,
            self._clock.to_ns_array(ticks),
            block.inputs,
            block.counts,
            block.status,
        )


class WholePath:
    """Everything between a read and a payload."""

    def __init__(self, model: ArmModel, rate_hz: float) -> None:
        self._model = model
        self._decoder = Decoder()
        self._timing = Timing()
        self._pipeline = Pipeline(model, HostClock())
        self._payloads: list[bytes] = []
        self._scanner = scanner(model, rate_hz, self._take)

    def run(self, reads: Sequence[bytes], taken_up: int) -> list[bytes]:
        """Payloads of all these reads, ``taken_up`` of them at a time."""
        for start in range(0, len(reads), taken_up):
            waiting = [
                self._timing.samples(block)
                for data in reads[start : start + taken_up]
                for block in self._decoder.feed(data)
                if isinstance(block, SampleBlock)
            ]
            if waiting:
                samples = CountSamples.joined(waiting)
                self._scanner.take(self._model, self._pipeline.poses(samples))
        self._scanner.stop()
        return self._payloads

    def _take(self, scan: Scan, _: Callable[[], object]) -> bool:
        self._payloads.append(encode(scan, "msgpack"))
        return True


def scanner(model: ArmModel, rate_hz: float, offer: ScanSink) -> Scanner:
    started = Scanner(HostClock(), offer, BLOCK_S)
    started.start(plan_scan(rate_hz, rate_hz), model, "bench")
    started.follow(1, rate_hz)
    return started


def whole_path(
    model: ArmModel, rate_hz: float, data: bytes, n: int, delivery: Delivery
) -> Task:
    reads = cut(data, delivery.read_bytes)

    def run() -> list[bytes]:
        return WholePath(model, rate_hz).run(reads, delivery.reads)

    return Task(f"whole path, {delivery.name}", run, n)


def stages(
    model: ArmModel, rate_hz: float, data: bytes, n: int, delivery: Delivery
) -> list[Task]:
    """The stages one by one; each processes the output of the one before."""
    reads = cut(data, delivery.read_bytes)
    decoder, timing = Decoder(), Timing()
    decoded = [b for read in reads for b in decoder.feed(read)]
    blocks = [b for b in decoded if isinstance(b, SampleBlock)]
    timed = [timing.samples(block) for block in blocks]
    k = delivery.reads
    joined = [timed[start : start + k] for start in range(0, len(timed), k)]
    samples = [CountSamples.joined(some) for some in joined]
    counts = [counts_block.counts[:, model.channels] for counts_block in samples]
    unwrapper = Unwrapper(model.encoders)
    unwrapped = [unwrapper.unwrap(some) for some in counts]
    angles = [counts_to_angles(model.encoders, some) for some in unwrapped]
    pipeline = Pipeline(model, HostClock())
    poses = [pipeline.poses(some) for some in samples]
    scans: list[Scan] = []
    _scanned(model, rate_hz, poses, scans)
    tasks: dict[str, Callable[[], object]] = {
        "frames: cut, COBS, CRC": lambda: _each(FrameSplitter().feed, reads),
        "frames and samples: decoder": lambda: _each(Decoder().feed, reads),
        "numbers and times": lambda: _each(Timing().samples, blocks),
        "blocks joined": lambda: _each(CountSamples.joined, joined),
        "turns counted": lambda: _each(Unwrapper(model.encoders).unwrap, counts),
        "angles": lambda: _each(partial(counts_to_angles, model.encoders), unwrapped),
        "correction and pose": lambda: _each(partial(_corrected, model), angles),
        "counts to poses: pipeline": lambda: _each(
            Pipeline(model, HostClock()).poses, samples
        ),
        "message, checked": lambda: _scanned(model, rate_hz, poses, []),
        "MessagePack": lambda: _each(_payload, scans),
    }
    return [Task(name, call, n) for name, call in tasks.items()]


def _each(call: Callable[..., object], items: Sequence[object]) -> None:
    for item in items:
        call(item)


def _corrected(model: ArmModel, angles_rad: Floats) -> object:
    block = Block(angles_rad=angles_rad)
    return corrected_pose(model.geometry, model.effects, block)


def _payload(scan: Scan) -> bytes:
    return encode(scan, "msgpack")


def _scanned(
    model: ArmModel, rate_hz: float, poses: Sequence[PoseBlock], scans: list[Scan]
) -> None:
    def take(scan: Scan, dropped: Callable[[], object]) -> bool:
        del dropped  # never called: everything is taken
        scans.append(scan)
        return True

    scanning = scanner(model, rate_hz, take)
    for block in poses:
        scanning.take(model, block)
    scanning.stop()

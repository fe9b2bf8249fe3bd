"""Measuring that is recorded, in time that a test sets: on one device or on two."""

import asyncio
import contextlib
from dataclasses import replace

import numpy as np

from tests.daemon.two_devices import BEGIN_NS, ON_TWO, TURNS, Reader, true_counts
from tests.daemon.values import ARM, UTC_OFFSET_NS
from tests.established import identify
from traverse.daemon.config.schema import RecordingSection
from traverse.daemon.executor import recorded_command
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.recorder.recorded_inputs import (
    read_recorded_inputs,
    recorded_files,
)
from traverse.daemon.recorder.recorder import Recorder, StepRecorder
from traverse.daemon.replay.replay import (
    Replay,
    ReplayClock,
    close_drivers,
    deliver,
    ignore_result,
    replay_measurement,
)
from traverse.drivers.base.values import (
    DeviceUp,
    Identity,
    LatchedCounts,
    StreamStarted,
)
from traverse.kinematics.model.kernel_choice import KERNEL
from traverse.recording.run_reader import RunReader

CONFIGURATION = """\
[arm]
file = "arm.toml"
[[device]]
id = "base"
driver = "latch-board"
port = "/dev/base"
{more}
[capture]
inputs = [{{ source = "base/0", trigger = "button" }}]
{capture}
[quality]
overspeed_mm_s = 800.0
"""
WRIST = """\
[[device]]
id = "wrist"
driver = "latch-board"
port = "/dev/wrist"
"""
EFFECTS = """
[[effects]]
kind = "backlash"
joint = "J2"
half_width_rad = 2e-5
[[effects]]
kind = "encoder_latency"
latency_s = 0.001
[[effects]]
kind = "encoder_drift"
joint = "J1"
rate_rad_s = 1e-9
epoch_utc = 2023-11-14T00:00:00Z
"""
IDENTITIES = {
    "base": Identity("board 1", "1", (1 << 20, 1 << 23, 1 << 16), 2, 1000.0),
    "wrist": Identity("line 2", "", (1 << 23, 1 << 23), 0, 80.0, latches=False),
}


class RecordedRun:
    """One run of measuring with a recorder.

    Args:
        folder: for the files.
        two: the arm is on two devices, else all on one board.
        capture: more of `[capture]`.
        section: of `[recording]`.
    """

    def __init__(self, folder, *, two=False, effects=EFFECTS, capture="", **section):
        self.folder, self.two = folder, two
        arm = (ON_TWO if two else ARM) + effects
        arm_path = folder / "arm.toml"
        arm_path.write_text(arm)
        covariance = identify(arm_path).with_suffix(".cov.npz")
        path = folder / "traverse.toml"
        more = WRIST if two else ""
        path.write_text(CONFIGURATION.format(more=more, capture=capture))
        paths = (arm_path, path, covariance)
        files = {file.name: file.read_bytes() for file in paths}
        self.configuration, self.model = read_recorded_inputs(files, None)
        assert recorded_files(path, self.configuration) == files
        self.clock = ReplayClock()
        self.clock.now_ns, self.clock.offset_ns = BEGIN_NS, UTC_OFFSET_NS
        self.points, self.scans, self.events = [], [], []
        recording = RecordingSection(**{"min_free_mb": 10, **section})
        self.steps = StepRecorder(self.clock, flight=recording.flight)
        self.recorder = Recorder(
            recording,
            self.steps,
            folder=folder / "recordings",
            clock=self.clock,
            about={"arm": "bench-7", "version": "0", "kernel": KERNEL},
            files=files,
            events=EventLog(self.clock, self.events.append),
        )
        self.measurement = replay_measurement(
            self.configuration,
            self.model,
            self.clock,
            take_point=self._publish,
            take_scan=self._publish_scan,
            listener=self.steps,
        )
        self.readers = [Reader("base", 100.0, (1, None, 0))]
        if two:
            skew_ns = (0, 300_000)
            self.readers.append(Reader("wrist", 80.0, (None, 2), skew_ns))
        else:
            self.readers = [Reader("base", 100.0, (1, 2, 0))]
        self.seq = {reader.device: 0 for reader in self.readers}
        self.token = 0
        self._stack = contextlib.AsyncExitStack()

    def _publish(self, point):
        self.points.append(point)
        self.steps.published(self.clock.now_ns, point)

    def _publish_scan(self, scan):
        self.scans.append(scan)
        self.steps.published(self.clock.now_ns, scan)

    async def __aenter__(self):
        await self._stack.enter_async_context(self.recorder.running())
        for reader in self.readers:
            self.take(DeviceUp(reader.device, IDENTITIES[reader.device], False))
            self.take(StreamStarted(reader.device, 1, reader.rate_hz))
        return self

    async def __aexit__(self, *reason):
        await self._stack.aclose()
        close_drivers(self.measurement)

    def later(self, seconds, every_s=0.05):
        """Let time pass: devices deliver, and the loop looks at the time."""
        end_ns = self.clock.now_ns + int(seconds * 1e9)
        while self.clock.now_ns < end_ns:
            self.clock.now_ns = min(end_ns, self.clock.now_ns + int(every_s * 1e9))
            for reader in self.readers:
                until = int((self.clock.now_ns - BEGIN_NS) * 1e-9 * reader.rate_hz)
                first = self.seq[reader.device]
                if until > first:
                    samples = reader.samples(range(first, until))
                    self.take(replace(samples, received_ns=self.clock.now_ns))
                    self.seq[reader.device] = until
            self.recorder.poll()
            if self.two or self.measurement.points.has_pending.is_set():
                self.measurement.process_timeouts()

    def take(self, delivery):
        deliver(self.measurement, delivery)

    def edge(self, *, active=True, ago_s=0.0123):
        """Press or release the board's button."""
        instant_ns = self.clock.now_ns - int(ago_s * 1e9)
        counts = np.zeros(3, np.int64)
        true = np.rint(true_counts(np.array([instant_ns]))[0]).astype(np.int64) % TURNS
        for channel, joint in enumerate(self.readers[0].channels):
            if joint is not None:
                counts[channel] = true[joint]
        self.token += 1
        self.take(
            LatchedCounts(
                "base",
                0,
                active,
                self.token,
                0,
                self.clock.now_ns,
                instant_ns,
                tuple(counts.tolist()),
                (0, 0, 0),
            )
        )

    def click(self):
        self.edge()
        self.edge(active=False, ago_s=0.001)

    def ask(self, what, **values):
        ignore_result(recorded_command(what, values).execute(self.measurement))


def replayed(path, block=None):
    points = []

    async def replay():
        with RunReader(path) as reader:
            return Replay(reader, block, take_point=points.append).run()

    return asyncio.run(replay()), points

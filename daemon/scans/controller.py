"""Scans: when one begins and ends, and which edges of buttons it depends on."""

import asyncio
from collections.abc import Callable
from dataclasses import asdict

from traverse.daemon.config.schema import ScanSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.points.capture import Capture
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.scans.scanner import Scanner
from traverse.drivers.base.values import LatchedCounts, StreamStarted


class ScanController:
    """Starts, holds and ends the scans of an arm, one at a time.

    Args:
        scanner: makes points and blocks of them.
        capture: knows the session.
        events: where it is told that an edge came too late.
        asked: told what is about to be carried out, with its values.

    Attributes:
        stream_started: set when the stream that the scan waits for has begun.
    """

    def __init__(
        self,
        scanner: Scanner,
        *,
        capture: Capture,
        events: EventLog,
        asked: Callable[..., object],
    ) -> None:
        self._scanner = scanner
        self._capture = capture
        self._events = events
        self._asked = asked
        self.stream_started = asyncio.Event()

    @property
    def is_running(self) -> bool:
        """A scan runs."""
        return self._scanner.plan is not None

    def use(self, block_s: float, settings: ScanSection) -> None:
        """Go by other settings."""
        self._scanner.use_settings(block_s, settings)

    def start(self, plan: ScanPlan, model: ArmModel) -> None:
        """Begin a scan; it ends a running one."""
        self.stop()
        self._asked("start_scan", **asdict(plan))
        self.stream_started.clear()
        self._scanner.start(plan, model, self._capture.session.id)

    def stop(self) -> int:
        """End the running scan; gives how many points it has."""
        if self.is_running:
            self._asked("stop_scan")
        return self._scanner.stop()

    def take(self, model: ArmModel, poses: PoseBlock) -> None:
        """Add the points of a block of poses."""
        self._scanner.take(model, poses)

    def on_stream_started(self, started: StreamStarted) -> None:
        """The arm's samples are of another stream from now on."""
        if self._scanner.follow(started.stream, started.rate_hz):
            self.stream_started.set()

    def on_button(self, device: str, number: int, latch: LatchedCounts) -> None:
        """A button was pressed or released: a scan may depend on it."""
        key = device, number
        late_s = self._scanner.edge(key, latch.sample_time_ns, latch.active)
        if late_s:
            self._events.report(
                "warning",
                "scan.edge_late",
                f"an edge of a button came {late_s:.3f} s too late: the held scan "
                f"{'begins' if latch.active else 'ends'} so much late here",
                source=f"{device}/{number}",
                remedy="raise held_wait_s of [scan], or lower the debounce time",
                data={"late_s": late_s},
            )

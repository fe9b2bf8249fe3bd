"""The arm as it measures: its devices, and the whole way from them to the output."""

import asyncio
from collections.abc import Callable

from traverse.daemon.acquisition.device import open_device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.config.schema import Configuration
from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.frozen_clock import FrozenClock
from traverse.daemon.health import HealthReport
from traverse.daemon.output import Output
from traverse.daemon.points.capture import Capture, triggers_of
from traverse.daemon.pose.alignment import ActiveAlignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.uncertainty import CovarianceEvaluator
from traverse.daemon.recorder.snapshot import MeasurementSnapshot
from traverse.daemon.scans.scanner import Scanner

TIME_S = 0.02
TURNS = 4  # of the loop, in which deliveries that wait already are taken


class Instrument:
    """Composed on the running loop; `measuring` shows what is done with deliveries.

    Args:
        configuration: in force.
        model: the arm.
        output: where points, scans, live poses and events go.
        steps: the clock by which everything is done.
        health: collects latencies.
        status_changed: called when a device's state has changed.

    Attributes:
        devices: all of the configuration.
        arm_devices: those of them that read the arm's joints.
        part: the alignment in use.
        capture: makes points.
        scanner: makes blocks of scans.
        live: makes live poses.
        measuring: brings every delivery to these three.
    """

    def __init__(
        self,
        configuration: Configuration,
        model: ArmModel,
        output: Output,
        *,
        steps: FrozenClock,
        health: HealthReport,
        status_changed: Callable[[], None],
    ) -> None:
        settings, spool, recorder = configuration.capture, output.spool, output.recorder
        self.part = ActiveAlignment()
        self.capture = Capture(steps, recorder.following(output.outbox.put), self.part)
        self.scanner = Scanner(
            steps, spool.offer, settings.scan_block_s, configuration.scan, self.part
        )
        spool.taken_back = self.scanner.take_back
        self.live = LivePoseSampler(steps, settings.live_rate_hz, self.part)
        loop = asyncio.get_running_loop()
        self.devices = [open_device(d, loop) for d in configuration.device]
        self.arm_devices = JointDevices(model, self.devices)
        self.measuring = Measuring(
            clock=steps,
            devices=self.arm_devices,
            settings=configuration.assembly,
            uncertainty=CovarianceEvaluator(configuration.uncertainty),
            pipeline=Pipeline(model, steps),
            capture=self.capture,
            triggers=triggers_of(settings),
            scanner=self.scanner,
            live=self.live,
            events=output.events,
            health=health,
            offer_live=lambda live: output.outlet.publish("live", live),
            status_changed=status_changed,
            taking=settings,
            quality=configuration.quality,
            tape=recorder,
        )
        recorder.state = MeasurementSnapshot(self.measuring, self.capture)

    async def process_timeouts(self) -> None:
        """See to what waits for readings, or for time to pass; else sleep."""
        while True:
            if not self.measuring.may_wait:
                await self.measuring.points.has_pending.wait()
            await asyncio.sleep(TIME_S)
            for _ in range(TURNS):
                await asyncio.sleep(0)
            self.measuring.process_timeouts()

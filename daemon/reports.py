"""What the daemon says of itself: its state, and its figures."""

from collections.abc import Sequence
from importlib.metadata import version

from daemon.arm_devices import ArmDevices
from daemon.capture import Capture
from daemon.clock import HostClock
from daemon.commands import CommandDesk
from daemon.counts import broker_health, counters_of
from daemon.device import Device
from daemon.health import HealthReport
from daemon.live import LiveView
from daemon.measuring import Measuring
from daemon.outbox import Outbox
from daemon.outgoing import OutgoingQueue
from daemon.publisher import Publisher
from daemon.recorder import Recorder
from daemon.scan_spool import ScanSpool
from daemon.scanner import Scanner
from kinematics.kernel.choice import KERNEL
from protocol.encoding import Encoding
from protocol.messages import Health, Status


class Reports:
    """Makes the messages `status` and `health` out of what the others know.

    Attributes:
        commands: that come in; set as soon as there is such a desk.
        publisher: likewise; no figures are asked for before.
    """

    commands: CommandDesk
    publisher: Publisher

    def __init__(
        self,
        *,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        devices: Sequence[Device],
        arm_devices: ArmDevices,
        measuring: Measuring,
        capture: Capture,
        scanner: Scanner,
        live: LiveView,
        outbox: Outbox,
        spool: ScanSpool,
        recorder: Recorder,
        queue: OutgoingQueue,
        health: HealthReport,
    ) -> None:
        self._arm = arm
        self._encoding = encoding
        self._clock = clock
        self._devices = devices
        self._arm_devices = arm_devices
        self._measuring = measuring
        self._capture = capture
        self._scanner = scanner
        self._live = live
        self._outbox = outbox
        self._spool = spool
        self._recorder = recorder
        self._queue = queue
        self._health = health

    def status(self, *, online: bool = True) -> Status:
        """The state now, or that of a daemon which is not there any more."""
        ready = self._outbox.is_ready and all(d.state == "ready" for d in self._devices)
        return Status(
            online=online,
            state="offline" if not online else "ready" if ready else "degraded",
            arm=self._arm,
            model=self._measuring.model.digest,
            version=version("traverse-cmm"),
            kernel=KERNEL,
            encoding=self._encoding,
            session=self._capture.session.id,
            time_ns=self._clock.monotonic_ns() + self._clock.utc_offset_ns(),
            drivers=tuple(device.status() for device in self._devices),
        )

    def health(self, *, anew: bool) -> Health:
        """The figures; ``anew`` begins another period with them."""
        return self._health.message(
            anew=anew,
            arm=self._arm,
            session=self._capture.session.id,
            devices=self._devices,
            broker=broker_health(self.publisher, self._queue),
            outbox=self._outbox.health(),
            spool=self._spool.health(),
            recording=self._recorder.health(),
            counters=counters_of(
                capture=self._capture,
                scanner=self._scanner,
                spool=self._spool,
                live=self._live,
                commands=self.commands,
                publisher=self.publisher,
                queue=self._queue,
            ),
            temperature_c=self._arm_devices.temperature_c,
            lacks=self._measuring.assembly.lacks(),
            skew_mm=self._measuring.skew.taken_mm(),
        )

"""Status and health: the daemon's state and figures."""

from importlib.metadata import version

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.dispatcher import CommandDispatcher
from traverse.daemon.health import HealthReport
from traverse.daemon.health_counters import broker_health, health_counters
from traverse.daemon.measurement import Measurement
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.output import Output
from traverse.kinematics.kernel.choice import KERNEL
from traverse.protocol.encoding import Encoding
from traverse.protocol.messages import Health, Status


class Reports:
    """Makes the messages `status` and `health` out of what the others know.

    Args:
        arm: name of the arm.
        encoding: of all payloads, which a status states.
        clock: the host's.
        measurement: that measures.
        output: receives all messages.
        commands: received.
        health: the figures collected.

    Attributes:
        publisher: to be set before figures are requested; it needs a status itself.
    """

    publisher: BrokerConnection

    def __init__(
        self,
        *,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        measurement: Measurement,
        output: Output,
        commands: CommandDispatcher,
        health: HealthReport,
    ) -> None:
        self._arm = arm
        self._encoding = encoding
        self._clock = clock
        self._measurement = measurement
        self._output = output
        self._commands = commands
        self._health = health

    def status(self, *, online: bool = True) -> Status:
        """The state now, or that of a daemon which is not there any more."""
        devices = self._measurement.devices.values()
        ready = self._output.outbox.is_ready and all(
            d.state == "ready" for d in devices
        )
        return Status(
            online=online,
            state="offline" if not online else "ready" if ready else "degraded",
            arm=self._arm,
            model=self._measurement.model.digest,
            version=version("traverse-cmm"),
            kernel=KERNEL,
            encoding=self._encoding,
            session=self._measurement.capture.session.id,
            time_ns=self._clock.monotonic_ns() + self._clock.utc_offset_ns(),
            drivers=tuple(device.status() for device in devices),
        )

    def health(self, *, anew: bool) -> Health:
        """The figures; ``anew`` begins another period with them."""
        measurement, output = self._measurement, self._output
        return self._health.message(
            anew=anew,
            arm=self._arm,
            session=measurement.capture.session.id,
            devices=list(measurement.devices.values()),
            broker=broker_health(self.publisher, output.queue),
            outbox=output.outbox.health(),
            spool=output.spool.health(),
            recording=output.recorder.health(),
            counters=health_counters(
                capture=measurement.capture,
                scanner=measurement.scanner,
                spool=output.spool,
                live=measurement.live,
                commands=self._commands,
                publisher=self.publisher,
                queue=output.queue,
            ),
            temperature_c=measurement.joint_devices.temperature_c,
            lacks=measurement.resampler.lacks(),
            skew_mm=measurement.skew.pop_largest_mm(),
        )

"""All that leaves the daemon: messages, events, points, scans and recordings."""

import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.recording import recorder_of, tell_reloaded
from traverse.daemon.config.schema import Configuration
from traverse.daemon.frozen_clock import FrozenClock
from traverse.daemon.health import HealthReport
from traverse.daemon.monitoring.events import EventLog, Occurrence
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.state_dir import OUTBOX, SCANS, state_path
from traverse.daemon.store.outbox import Outbox
from traverse.daemon.store.scan_store import ScanStore
from traverse.drivers.base.heartbeat import Heartbeat
from traverse.protocol.encoding import Encoding


class Output:
    """Composed of what keeps results, and of the queue that all messages go through.

    Args:
        configuration: in force.
        path: of its file.
        arm: name of the arm.
        encoding: of all payloads.
        clock: the host's.
        steps: the same, as steps of the measuring are recorded.
        health: receives the durations of points.
        session: gives the id of the running session.
        status_changed: called when points can be kept again, or cannot any more.

    Attributes:
        queue: of what is to be published.
        outlet: by which messages get there.
        events: likewise for what happened.
        recorder: writes recordings.
        outbox: keeps points until the broker has them.
        spool: does so for scans that are to be complete.
        told: called with each event that has been published; the service sets it.
    """

    def __init__(
        self,
        configuration: Configuration,
        path: Path,
        *,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        steps: FrozenClock,
        health: HealthReport,
        session: Callable[[], str],
        status_changed: Callable[[], None],
    ) -> None:
        self._path = path
        self._session = session
        self.told: Callable[[Occurrence], None] = lambda what: None
        self.queue = OutgoingQueue()
        self.outlet = MessagePublisher(arm, encoding, self.queue, clock)
        self.events = EventLog(clock, self._publish_event, arm)
        self.recorder = recorder_of(
            configuration, path, arm=arm, clock=steps, events=self.events
        )
        self.outlet.tape = self.recorder
        self.outbox = Outbox(
            state_path(path) / OUTBOX,
            arm=arm,
            encoding=encoding,
            clock=clock,
            section=configuration.outbox,
            limit=configuration.capture.max_waiting_points,
            session=session,
            queue=self.queue,
            events=self.events,
            latencies=health.latencies,
            changed=status_changed,
        )
        self.spool = ScanStore(
            state_path(path) / SCANS,
            arm=arm,
            encoding=encoding,
            clock=clock,
            section=configuration.scan,
            outlet=self.outlet,
            queue=self.queue,
            events=self.events,
        )

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Keep points, scans and recordings while the block lasts.

        Raises:
            StoreRefusedError: a database must be left alone.
        """
        async with self.outbox.running(), self.spool.running(), self.recorder:
            yield

    @property
    def heartbeats(self) -> tuple[Heartbeat, ...]:
        """Signs of life of the threads that write."""
        return (self.outbox.heartbeat, self.recorder.heartbeat, *self.spool.heartbeats)

    def use(self, configuration: Configuration) -> None:
        """Go by a new configuration."""
        self.outbox.use(configuration.outbox)
        self.spool.use(configuration.scan)
        tell_reloaded(self.recorder, self._path, configuration)

    def poll(self) -> None:
        """Go on with what has been put off; call it a few times a second."""
        self.events.flush()
        self.outbox.poll()
        self.spool.poll()
        self.recorder.poll()

    async def idle(self) -> None:
        """Wait until everything is on the disk and with the broker."""
        await self.outbox.idle()
        await self.spool.idle()
        await self.queue.empty()

    def _publish_event(self, what: Occurrence) -> None:
        self.outlet.publish_event(what, self._session())
        self.told(what)

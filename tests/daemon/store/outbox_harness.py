"""An outbox on the event loop, and the broker that takes from it."""

from tests.daemon.store.scan_store_harness import Bench
from tests.daemon.values import SetClock
from tests.end_to_end.programs import until
from tests.protocol.message_examples import POINT
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.config.schema import OutboxSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.latencies import latencies_by_name
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.points.capture import Session
from traverse.daemon.store.outbox import Outbox
from traverse.daemon.store.retention_clock import FIRST_NS
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Point, ResendArgs


class OutboxOnLoop:
    """An outbox in a folder; points are numbered as `Capture` does."""

    def __init__(self, folder, limit=10_000, **section):
        self.path = folder / "outbox.db"
        self.queue = OutgoingQueue()
        self.occurrences = []
        self.clock = SetClock()
        self.session = Session(1, "note")
        self.statuses = []
        self.latencies = latencies_by_name()
        self.outbox = Outbox(
            self.path,
            MessagePublisher("bench-7", "msgpack", self.queue, self.clock),
            EventLog(self.clock, self.occurrences.append),
            section=OutboxSection(**section),
            limit=limit,
            latencies=self.latencies,
            ready_changed=lambda: self.statuses.append(self.outbox.is_ready),
        )

    def run_for_minutes(self):
        """Let the first minutes of a run pass, with a clock that is believed."""
        self.outbox.trust_clock(True)
        self.clock.now_ns += FIRST_NS

    def take(self):
        """A point as `Capture` hands it on; None where there is no room."""
        session = self.session
        point = POINT.model_copy(
            update={
                "session": session.id,
                "seq": session.next_seq,
                "id": session.next_id,
            }
        )
        keeping = self.outbox.put_point(point, session.begun_ns, session.note)
        if keeping is not None:
            session.add(point)
            keeping.on_roll_back(lambda: session.roll_back(point))
        return keeping

    async def resend(self, **args):
        scans = Bench(self.path.parent).spool
        commands = ResendCommands(self.outbox, scans, ())
        return await commands.carry_out(ResendArgs(**args))

    async def take_all(self, n):
        keepings = [self.take() for _ in range(n)]
        await until(lambda: all(k.is_settled for k in keepings), "they are settled")
        return keepings

    def send(self, n=10**6):
        sent = []
        while len(sent) < n and (taken := self.queue.next()) is not None:
            self.queue.done(*taken)
            if taken[0] in ("point", "resend"):
                sent.append((taken[0], decode(Point, taken[1].payload).seq))
        return sent

    async def send_until(self, n):
        sent = []

        def are_there() -> bool:
            sent.extend(self.send())
            return len(sent) >= n

        await until(are_there, f"{n} messages, so far {len(sent)}")
        return sent

    def codes(self, active=None):
        return [o.code for o in self.occurrences if o.active is active]


def numbers(kind, *values):
    return [(kind, value) for value in values]

"""Points reach the broker in order and all of them, however thread and loop take turns.

The thread's and the loop's work are done step by step, as a plan says; the connection
breaks now and then. The plan also has marks that the disk refuses.
"""

from collections import deque

from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.daemon.store.outbox_entries import entries, entry, rows
from tests.daemon.values import SetClock
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.database import MessageDatabase
from traverse.daemon.store.forwarder import (
    BATCH,
    REFUSED_NS,
    AckBuffer,
    UnsentFeeder,
    outgoing,
)

ROOM = BATCH + 50


class Steps:
    def __init__(self, path):
        self.path = path
        self.store = MessageDatabase(path)
        self.store.connection.execute("PRAGMA synchronous = OFF")
        self.jobs, self.results = deque(), deque()
        self.queue = OutgoingQueue(max_points=ROOM)
        self.read = self.store.read
        self.acks = AckBuffer(self)
        self.clock = SetClock()
        self.feed = UnsentFeeder(self.queue, self, self.acks, self.clock, Latencies())
        self.sent, self.on_the_way = [], deque()
        self.taken = 0
        self.marks_fail = False

    def query(self, work, deliver):
        self.jobs.append((work, deliver))

    def mark_sent(self, ranges):
        if self.marks_fail:
            return OSError("the disk is full")
        return self.store.mark_sent(ranges)

    def take(self, n):
        group = entries("s", n, first=self.taken)
        self.taken += n

        def kept(numbers):
            for number, e in zip(numbers, group, strict=True):
                self.feed.add(number, e)

        if n:
            self.query(lambda _: self.store.add(group), kept)

    def thread(self, n):
        for _ in range(min(n, len(self.jobs))):
            work, deliver = self.jobs.popleft()
            self.results.append((deliver, work(self)))

    def loop(self, n):
        for _ in range(min(n, len(self.results))):
            deliver, result = self.results.popleft()
            deliver(result)

    def write(self, n):
        while n and (taken := self.queue.next()) is not None:
            self.on_the_way.append(taken)
            n -= 1

    def acknowledge(self, n):
        for _ in range(min(n, len(self.on_the_way))):
            kind, message = self.on_the_way.popleft()
            self.sent.append(int(message.payload.split()[1]))
            self.queue.done(kind, message)

    def refuse(self, n):
        for _ in range(min(n, len(self.on_the_way))):
            self.queue.defer(*self.on_the_way.popleft())

    def turn(self):
        for step in (self.poll, self.thread, self.loop, self.write):
            step(2000)

    def break_off(self, n):
        self.on_the_way.clear()
        self.queue.take_back()

    def poll(self, n):
        self.marks_fail = n % 2 == 1
        self.acks.flush()
        self.feed.refill()

    def finish(self):
        self.break_off(0)
        while len(self.sent) < self.taken or self.jobs or self.results:
            before = len(self.sent), len(self.jobs), len(self.results)
            for step in (self.poll, self.thread, self.loop, self.write):
                step(10_000)
            self.acknowledge(10_000)
            if (len(self.sent), len(self.jobs), len(self.results)) == before:
                break
        for _ in range(2):
            self.poll(0)
            self.thread(9)
            self.loop(9)


NAMES = ("take", "thread", "loop", "write", "acknowledge", "break_off", "poll")
PLANS = st.lists(
    st.tuples(st.sampled_from(NAMES), st.integers(0, 130)), min_size=5, max_size=60
)


@settings(max_examples=30)
@given(PLANS)
@example([("poll", 0), ("thread", 9), ("take", 5), ("loop", 9), ("thread", 9)])
def test_every_point_is_sent_in_order_and_marked(tmp_path_factory, plan):
    path = tmp_path_factory.mktemp("feed") / "outbox.db"
    steps = Steps(path)
    for name, n in plan:
        getattr(steps, name)(n)
        assert steps.queue.waiting("point") <= ROOM
    steps.finish()
    assert steps.sent == [*range(steps.taken)]
    assert all(sent for _, _, sent in rows(path))
    steps.store.close()


def test_what_the_broker_refuses_is_repeated_after_two_minutes_and_not_before(
    tmp_path,
):
    steps = Steps(tmp_path / "outbox.db")
    steps.take(5)
    steps.turn()
    steps.turn()
    steps.acknowledge(2)
    steps.refuse(3)
    steps.take(2)  # they wait with those

    for _ in range(3):
        steps.turn()
    assert (steps.sent, list(steps.on_the_way)) == ([0, 1], [])

    steps.clock.now_ns += REFUSED_NS
    for _ in range(3):
        steps.turn()
    steps.acknowledge(1)
    steps.refuse(4)  # some of them once more

    steps.clock.now_ns += REFUSED_NS
    for _ in range(3):
        steps.turn()
    steps.acknowledge(99)
    steps.turn()
    steps.turn()
    assert steps.sent == [*range(7)]
    assert all(sent for _, _, sent in rows(steps.path))
    steps.store.close()


def test_what_another_run_left_in_another_encoding_says_so():
    message = outgoing(entry(encoding="json", payload=b"{}"))
    assert (message.topic, message.payload, message.encoding) == (
        "traverse/arm/point",
        b"{} 0",
        "json",
    )
    assert (message.qos, message.retain) == (1, False)

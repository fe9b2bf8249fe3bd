"""A spool of scans on the event loop, and its broker."""

import numpy as np

from tests.daemon.store.outbox_entries import rows
from tests.daemon.values import SetClock
from tests.end_to_end.programs import until
from tests.protocol.message_examples import SCAN
from traverse.daemon.config.schema import ScanSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.message_publisher import MessagePublisher
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.store.scan_store import ScanStore
from traverse.protocol.encoding import decode
from traverse.protocol.messages import Scan

POINTS = 5


def block(number, *, scan="scan", last=False, points=POINTS):
    rows_of = {
        name: np.resize(value, (points, *value.shape[1:]))
        for name in (
            *("xyz_mm", "ijk", "angles_rad", "counts", "part_xyz_mm", "quality"),
            "covariance_mm2",
        )
        if (value := getattr(SCAN, name)) is not None
    }
    seq = number * POINTS
    return SCAN.model_copy(
        update={
            **rows_of,
            "scan": scan,
            "seq": seq,
            "dtime_ns": np.arange(points, dtype=np.int64),
            "last": last,
            "total": seq + points if last else None,
        }
    )


class Bench:
    def __init__(self, folder, **section):
        self.path = folder / "scans.db"
        self.queue = OutgoingQueue()
        self.occurrences = []
        self.clock = SetClock()
        self.taken_back = []
        self.spool = ScanStore(
            self.path,
            MessagePublisher("bench-7", "msgpack", self.queue, self.clock),
            EventLog(self.clock, self.occurrences.append),
            ScanSection(**{"delivery": "complete", **section}),
        )

    def take(self, scan):
        return self.spool.offer(
            scan, lambda: self.taken_back.append((scan.scan, len(scan.dtime_ns)))
        )

    async def offer(self, *numbers, **options):
        taken = [self.take(block(n, **options)) for n in numbers]
        await self.spool.idle()
        return taken

    def send(self):
        sent = []
        while (taken := self.queue.next()) is not None:
            kind, message = taken
            assert message.qos == (0 if kind == "scan" else 1)
            assert message.topic == "traverse/bench-7/scan"
            got = decode(Scan, message.payload, "msgpack")
            sent.append((got.scan, got.seq // POINTS))
            self.queue.done(kind, message)
        return sent

    async def send_all(self, n):
        sent = []

        def so_many():
            self.spool.poll()
            sent.extend(self.send())
            return len(sent) >= n

        await until(so_many, f"{n} blocks are sent")
        return sent

    async def all_marked(self):
        def marked():
            self.spool.poll()
            return all(is_sent for *_, is_sent in rows(self.path))

        await until(marked, "all blocks are marked")

    def codes(self):
        return [(o.code, o.active) for o in self.occurrences]

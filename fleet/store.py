"""A store, which writes each message into tables and files once."""

import time
from collections.abc import Sequence

from traverse.client.mqtt.connection import IncomingMessage
from traverse.fleet.database import BadValueError, Database, Run
from traverse.fleet.rows import Rows, refused_row
from traverse.fleet.scan_files import ScanFiles
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Scan

REFUSED_KEPT = 1000
"""Of messages that could not be stored, the latest."""
_REFUSED = (
    "INSERT INTO refused (time_ns, topic, reason, payload) VALUES (%s, %s, %s, %s)"
)
_KNOWN_BLOCKS = """SELECT seq FROM scan_block WHERE arm = %s AND session = %s
    AND scan = %s AND seq >= %s AND seq <= %s"""


class Store:
    """Writes for one thread.

    Args:
        database: with its tables.
        files: of scans.

    Attributes:
        n_refused: messages that could not be stored; the table `refused` lists them.
    """

    def __init__(self, database: Database, files: ScanFiles) -> None:
        self._database = database
        self._files = files
        self.n_refused = 0

    def write(self, batch: Sequence[IncomingMessage]) -> None:
        """Store a whole batch or nothing; refused messages go into their own table.

        Raises:
            StoreAwayError: nothing was stored; may be tried again.
        """
        try:
            self._write(batch)
        except BadValueError as error:
            if len(batch) > 1:  # the others are good
                for message in batch:
                    self.write([message])
                return
            with self._database.transaction() as run:
                self._refuse(run, batch[0], str(error))

    def _write(self, batch: Sequence[IncomingMessage]) -> None:
        rows, bad = Rows(), list[tuple[IncomingMessage, str]]()
        scans: dict[str, list[Scan]] = {}
        for message in batch:
            try:
                topic = topics.parse_topic(message.topic)
                if topic.kind == "scan":
                    scan = decode(Scan, message.payload)
                    scans.setdefault(topic.arm, []).append(scan)
                else:
                    rows.add(topic.kind, topic.arm, message.payload)
            except MessageError as error:
                bad.append((message, str(error)))
        for arm, blocks in scans.items():
            for block, file in self._files.write(arm, self._unknown(arm, blocks)):
                rows.add_block(block, arm, file)
        with self._database.transaction() as run:
            rows.write(self._database, run)
            for message, reason in bad:
                self._refuse(run, message, reason)

    def _unknown(self, arm: str, blocks: Sequence[Scan]) -> list[Scan]:
        """Leave out rows that are stored, or twice in the batch."""
        by_scan: dict[tuple[str, str], list[int]] = {}
        for block in blocks:
            by_scan.setdefault((block.session, block.scan), []).append(block.seq)
        known: set[tuple[str, str, int]] = set()
        with self._database.transaction() as run:
            for scan, seqs in by_scan.items():
                stored_seqs = run(_KNOWN_BLOCKS, (arm, *scan, min(seqs), max(seqs)))
                known.update((*scan, seq) for (seq,) in stored_seqs)
        left = []
        for block in blocks:
            place = (block.session, block.scan, block.seq)
            if place not in known:
                known.add(place)
                left.append(block)
        return left

    def _refuse(self, run: Run, message: IncomingMessage, reason: str) -> None:
        self.n_refused += 1
        now_ns = time.time_ns()
        row = refused_row(now_ns, message.topic, reason, message.payload)
        run(_REFUSED, row)
        run(
            "DELETE FROM refused WHERE time_ns < (SELECT min(time_ns) FROM (SELECT "
            "time_ns FROM refused ORDER BY time_ns DESC LIMIT %s) AS kept)",
            (REFUSED_KEPT,),
        )

"""Sets of positions, one for each SYNC: the fast path of CANopen.

All nodes latch at a SYNC and answer one after the other, so a set is stamped with the
instant of its SYNC and never with those of its frames. It is closed when all nodes have
answered, or by the next SYNC; a node that has not answered is marked `STATUS_MISSING`.
A node that has missed a SYNC owes an answer, which may still come: until it has, or has
not come for two more SYNCs, sets are held open until the next SYNC, so that the last of
its answers counts, and what may be of the wrong SYNC is marked `STATUS_LATE`.
"""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from drivers.values import STATUS_ERROR, STATUS_LATE, STATUS_MISSING, CountSamples
from protocol import canopen as wire

GATHER_NS = 10_000_000  # samples of so long are handed over together
MOST_OWED = 50
FORGIVEN_AFTER = 2  # SYNCs that were answered once since: what was owed is lost


class Cycles:
    """Positions of one stream, gathered by SYNC.

    Args:
        device: id in the configuration.
        nodes: by channel.
        moduli: by channel, where counts wrap.
        counts: by channel, the last known.
        deliver: takes finished blocks.

    Attributes:
        status: by channel, what is known of a node besides; set by whoever knows.
        lost: SYNCs that no node answered, or that were not sent, since last asked.
        missing: by channel, SYNCs that were not answered while others did.
        duplicates: by channel, second answers in one cycle.
        late: answers after the next SYNC.
        strays: answers while no cycle was open, or without a position.
        complete: sets with all answers.
        delivered: samples handed over.
        seen: bit by channel, who has answered anything since it was last cleared.
    """

    def __init__(
        self,
        device: str,
        nodes: Sequence[int],
        moduli: Sequence[int],
        counts: Sequence[int],
        deliver: Callable[[CountSamples], object],
    ) -> None:
        self._device, self._deliver = device, deliver
        self._channels = {wire.TPDO1 + n: channel for channel, n in enumerate(nodes)}
        self._moduli = np.array(moduli, dtype=np.uint64)
        self._all = (1 << len(nodes)) - 1
        self._counts = list(counts)
        self.status = bytearray(len(nodes))
        self._stream = 0
        self._seq = -1
        self._open = False  # a SYNC is out and its set not yet closed
        self._time_ns = 0
        self._answered = self._all
        self._owing = 0  # bit by channel: who owes
        self._owed = [0] * len(nodes)
        self._since = [0] * len(nodes)  # SYNCs answered while it owes
        self._seqs: list[int] = []
        self._times_ns: list[int] = []
        self._rows: list[int] = []
        self._states = bytearray()
        self._flushed_ns = 0
        self.lost = 0
        self.missing: Counter[int] = Counter()
        self.duplicates: Counter[int] = Counter()
        self.late = self.strays = self.complete = self.delivered = 0
        self.seen = 0

    def restart(self, stream: int) -> None:
        """Begin a stream; what the old one has gathered is dropped."""
        self._stream, self._seq = stream, -1
        self._open = False
        self._answered, self._owing = self._all, 0
        self._forget()

    def sync(self, time_ns: int, steps: int = 1) -> None:
        """A SYNC has been sent.

        Args:
            time_ns: when.
            steps: instants of the schedule since the last one; more than 1 where
                SYNCs were left out.
        """
        if self._open:
            self._close()
        self._seq += steps
        self.lost += steps - 1
        self._time_ns = time_ns
        self._answered = 0
        self._open = True

    def take(self, can_id: int, data: bytes | bytearray) -> bool:
        """Take a frame if it is a position; False for all others."""
        channel = self._channels.get(can_id)
        if channel is None:
            return False
        if len(data) < 4 or self._seq < 0:
            self.strays += 1
            return True
        bit = 1 << channel
        self.seen |= bit
        if self._answered & bit:
            if not self._owing & bit:
                self.duplicates[channel] += 1
                return True
            self.late += 1  # what came before answered an earlier SYNC
            self._owed[channel] -= 1
            if not self._owed[channel]:
                self._owing &= ~bit
        self._counts[channel] = wire.POSITION.unpack_from(data)[0]
        self._answered |= bit
        if self._answered == self._all and self._open and not self._owing:
            self._close()
        return True

    def end(self, now_ns: int) -> None:
        """No SYNC comes any more; the set of the last one is dropped."""
        self._open = False
        self._seq = -1
        self.flush(now_ns, at_once=True)

    def flush(self, now_ns: int, at_once: bool = False) -> None:
        """Hand over what is gathered, when it is time."""
        n = len(self._seqs)
        if not n or (not at_once and now_ns - self._flushed_ns < GATHER_NS):
            return
        self._flushed_ns = now_ns
        shape = (n, len(self.status))
        counts = np.array(self._rows, dtype=np.uint32).reshape(shape)
        status = np.frombuffer(bytes(self._states), dtype=np.uint8).reshape(shape)
        beyond = counts >= self._moduli
        if beyond.any():  # no encoder counts so far: what it says is not its position
            status = status | STATUS_ERROR * beyond.astype(np.uint8)
            counts = (counts % self._moduli).astype(np.uint32)
        times_ns = np.array(self._times_ns, dtype=np.int64)
        samples = CountSamples(
            self._device,
            self._stream,
            np.array(self._seqs, dtype=np.int64),
            times_ns,
            now_ns,
            times_ns,
            np.zeros(n, dtype=np.uint8),
            counts,
            status,
        )
        self._forget()
        self.delivered += n
        self._deliver(samples)

    def _close(self) -> None:
        self._open = False
        missed = self._all & ~self._answered
        status = self._judged(missed) if missed | self._owing else self.status
        if not self._answered:
            self.lost += 1
            return
        self._seqs.append(self._seq)
        self._times_ns.append(self._time_ns)
        self._rows += self._counts
        self._states += status
        if not missed:
            self.complete += 1
            return
        for channel in range(len(status)):
            if missed >> channel & 1:
                self.missing[channel] += 1

    def _judged(self, missed: int) -> bytearray:
        """The status of a set in which somebody has missed, or owes."""
        status = bytearray(self.status)
        for channel in range(len(status)):
            bit = 1 << channel
            if missed & bit:
                status[channel] |= STATUS_MISSING
                self._owed[channel] = min(self._owed[channel] + 1, MOST_OWED)
                self._since[channel] = 0
                self._owing |= bit
            elif self._owing & bit:
                status[channel] |= STATUS_LATE
                self._since[channel] += 1
                if self._since[channel] >= FORGIVEN_AFTER:
                    self._owed[channel] = 0
                    self._owing &= ~bit
        return status

    def _forget(self) -> None:
        self._seqs.clear()
        self._times_ns.clear()
        self._rows.clear()
        self._states.clear()

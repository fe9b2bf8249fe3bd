"""Sets of positions, one for each SYNC: the fast path of CANopen.

All nodes latch at a SYNC and answer one after the other, so a set has the instant of
its SYNC. It is closed when all nodes have answered, or by the next SYNC; a node without
an answer is marked `STATUS_MISSING`. Sets with a pending answer are held until the next
SYNC, so that the last of its answers counts; answers that may be of another SYNC are
marked `STATUS_LATE`, until `drivers/canopen/sync_attribution.py` excludes that.
"""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from traverse.drivers.base.values import STATUS_ERROR, STATUS_LATE, CountSamples
from traverse.drivers.canopen.sync_attribution import SyncAttribution
from traverse.protocol.canopen import frames as wire

BATCH_WINDOW_NS = 10_000_000  # samples of so long are handed over together
PAUSE_EVERY = 5  # times ``late_ns`` at least: so much of the time SYNCs continue


class SyncCycleAssembler:
    """Positions of one stream, gathered by SYNC.

    ``counts`` are the last known; no answer arrives later than ``late_ns`` after its
    SYNC. Unless ``stamped`` by the bus, a SYNC is later than its stamp: it was there
    before the first answer to it, which pending answers to earlier ones precede.

    Attributes:
        status: by channel, further status of a node; set from outside.
        lost: SYNCs that no node answered, or that were not sent, since the last call.
        missing: by channel, SYNCs that were not answered while others did.
        duplicates: by channel, second answers in one cycle.
        late: answers after the next SYNC.
        doubtful: by channel, answers that may be of another SYNC.
        pauses: how often no SYNC was sent until it was clear who answers what.
        strays: answers while no cycle was open, to a SYNC that may have been lost
            unread, or without a position.
        seen: bit by channel, set if it has answered since it was last cleared.
    """

    def __init__(
        self,
        device: str,
        nodes: Sequence[int],
        moduli: Sequence[int],
        counts: Sequence[int],
        deliver: Callable[[CountSamples], object],
        *,
        late_ns: int,
        stamped: bool = True,
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
        self._late_ns, self._stamped = late_ns, stamped
        self._bound_ns = 0
        self._answered_ns = [0] * len(nodes)  # arrival of the last answer, by channel
        self._attribution = SyncAttribution(len(nodes))
        self._overflowed = False  # frames were lost since the last SYNC
        self._no_pause_before_ns = self._no_wait_before_ns = 0
        self._seqs: list[int] = []
        self._times_ns: list[int] = []
        self._rows: list[int] = []
        self._states = bytearray()
        self._flushed_ns = 0
        self.lost = 0
        self.missing: Counter[int] = Counter()
        self.duplicates: Counter[int] = Counter()
        self.doubtful: Counter[int] = Counter()
        self.late = self.strays = self.complete = self.delivered = self.pauses = 0
        self.seen = 0

    def restart(self, stream: int) -> None:
        self._stream, self._seq = stream, -1
        self._open = False
        self._forget()

    def sync(self, time_ns: int, steps: int = 1) -> None:
        """Take a sent SYNC.

        ``steps`` is more than 1 if SYNCs of the schedule were left out.
        """
        ambiguous = self.ambiguous
        if self._open:
            self._close()
        if time_ns - self._time_ns >= self._late_ns:
            self._after_pause(time_ns, ambiguous)
        self._overflowed = False
        self._seq += steps
        self.lost += steps - 1
        self._time_ns = time_ns
        self._answered = 0
        self._open = True

    def take(self, can_id: int, data: bytes | bytearray, time_ns: int = 0) -> bool:
        """Take a frame if it is a position, with its arrival; False for all others."""
        channel = self._channels.get(can_id)
        if channel is None:
            return False
        if len(data) < 4:
            self.strays += 1
            return True
        bit = 1 << channel
        self.seen |= bit
        attribution = self._attribution
        if self._answered & bit:
            if not self._take_extra_answer(channel):
                return True
        elif attribution.pending & bit:
            self.doubtful[channel] += 1
        self._counts[channel] = wire.POSITION.unpack_from(data)[0]
        self._answered_ns[channel] = time_ns
        self._answered |= bit
        if self._answered == self._all and self._open and not attribution.pending:
            self._close()
        return True

    def note_lost_frames(self) -> None:
        """Note that frames of unknown nodes were lost before they could be read."""
        self._attribution.invalidate_all()
        self._overflowed = True

    def reset_attribution(self, channels: int) -> None:
        """Drop pending answers of nodes that were set up anew."""
        self._attribution.reset(channels)

    @property
    def ambiguous(self) -> int:
        """Bit by channel: nodes that answer, but need a pause to be attributed."""
        return self._attribution.ambiguous(self._answered) if self._seq >= 0 else 0

    @property
    def pause_until_ns(self) -> int:
        """Until when no SYNC is to be sent, so that answers are certain again; or 0."""
        if not self.ambiguous or self._time_ns < self._no_pause_before_ns:
            return 0
        return self._time_ns + self._late_ns

    @property
    def wait_until_ns(self) -> int:
        """Until when a SYNC should wait for pending answers; or 0."""
        late = self._all & ~(self._answered | self._attribution.unanswered)
        if not self._open or not late or self._time_ns < self._no_wait_before_ns:
            return self.pause_until_ns
        return self._time_ns + self._late_ns

    def end(self, now_ns: int) -> None:
        """End the stream; the set of the last SYNC is dropped."""
        if self._open:
            self._attribution.record_missed(self._all & ~self._answered)
        self._open = False
        self._seq, self._answered = -1, self._all
        self.flush(now_ns, at_once=True)

    def flush(self, now_ns: int, at_once: bool = False) -> None:
        """Hand over complete sets, when it is time."""
        n = len(self._seqs)
        if not n or (not at_once and now_ns - self._flushed_ns < BATCH_WINDOW_NS):
            return
        self._flushed_ns = now_ns
        shape = (n, len(self.status))
        counts = np.array(self._rows, dtype=np.uint32).reshape(shape)
        status = np.frombuffer(bytes(self._states), dtype=np.uint8).reshape(shape)
        beyond = counts >= self._moduli
        if beyond.any():  # no encoder counts so far: not its position
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
            time_bound_ns=self._bound_ns,
        )
        self._forget()
        self.delivered += n
        self._deliver(samples)

    def _close(self) -> None:
        self._open = False
        missed = self._all & ~self._answered
        status = self._attribution.flag(self.status, missed)
        latest_ns = 0 if self._stamped else self._latest_latch_ns()
        if missed | self._attribution.unanswered:
            self._attribution.record_missed(missed)
        if not self._answered:
            self.lost += 1
            return
        self._seqs.append(self._seq)
        self._times_ns.append(self._time_ns)
        if not self._stamped:
            self._bound_ns = max(self._bound_ns, latest_ns - self._time_ns)
        self._rows += self._counts
        self._states += status
        if not missed:
            self.complete += 1
            return
        for channel in range(len(status)):
            if missed >> channel & 1:
                self.missing[channel] += 1

    def _latest_latch_ns(self) -> int:
        """Return when the nodes have latched at the latest: before the first answer."""
        attribution = self._attribution
        certain = self._answered & ~(attribution.pending | attribution.invalidated)
        return min(
            (
                answered_ns
                for channel, answered_ns in enumerate(self._answered_ns)
                if certain >> channel & 1
            ),
            default=self._time_ns + self._late_ns,
        )

    def _after_pause(self, time_ns: int, ambiguous: int) -> None:
        """Process a pause of ``late_ns`` without SYNCs, up to this one."""
        next_ns = time_ns + PAUSE_EVERY * self._late_ns
        if self._attribution.unanswered:
            self._no_wait_before_ns = next_ns
        if ambiguous:
            self.pauses += 1
            self._no_pause_before_ns = next_ns
        if not self._overflowed:  # else some may have been lost
            self._attribution.expire()

    def _take_extra_answer(self, channel: int) -> bool:
        """Take an answer without a SYNC; return whether it replaces the last one."""
        if self._attribution.resolve(
            channel
        ):  # earlier frames answered an earlier SYNC
            self.late += 1
            return self._seq >= 0
        if self._seq < 0:
            self.strays += 1
            return False
        if self._attribution.maybe_unread >> channel & 1:
            self.strays += 1
        else:
            self.duplicates[channel] += 1
            self._attribution.invalidate(1 << channel)
        if self._seqs and self._seqs[-1] == self._seq:  # not yet handed over
            self._states[channel - len(self.status)] |= STATUS_LATE
        return False

    def _forget(self) -> None:
        self._seqs.clear()
        self._times_ns.clear()
        self._rows.clear()
        self._states.clear()
        self._bound_ns = 0

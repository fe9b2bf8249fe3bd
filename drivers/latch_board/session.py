"""An identified latch board: its samples, edges and clock."""

from collections import Counter
from collections.abc import Callable, Sized

import numpy as np

from traverse.arrays import Booleans, Integers
from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    STATUS_WARNING,
    CountSamples,
    DeviceError,
    LatchedCounts,
)
from traverse.drivers.latch_board.line import PartialReads
from traverse.drivers.latch_board.sequences import EdgeSequencer, StreamSequence
from traverse.drivers.timing.device_clock import UNKNOWN_NS, DeviceClock
from traverse.plurals import counted
from traverse.protocol.latch_board import messages as wire

WRAP = 1 << 32
NUMBERED_NS = 20_000_000  # from a level that has held to the number of its edge
LATCHED_AHEAD_NS = 1_000_000  # of its own arrival: by another counter
NOTICED_NS = 20_000_000  # in which a board that stood still notices what was meanwhile
MAX_EARLY = 16  # edges, as many as a board repeats
MAX_HELD = 64  # blocks that wait for an answer
WAITING_NS = 3_000_000_000  # longer than a quiet line takes to tie a clock
# The maker's own bits of a status byte are unspecified warnings.
_MAKERS = 0xF0
_STATUS_ARRAY = np.array(
    [s & ~_MAKERS | (STATUS_WARNING if s & _MAKERS else 0) for s in range(256)],
    dtype=np.uint8,
)
"""Status of all drivers by the board's status byte."""
_STATUS_BYTES = _STATUS_ARRAY.tobytes()


class LatchBoardSession:
    """One connection to a board, with one stream at a time.

    Args:
        path: of its port, for people.
        edges: their order, which outlives the connection.
        clock: of the board, perhaps tied to the host's already.
        debounce_ns: how long an input holds its level before its edge is numbered.
        put: hands a delivery over; False where it has no room.
        fault: reports survived faults: code, text, remedy, how often.
    """

    def __init__(
        self,
        device: str,
        path: str,
        edges: EdgeSequencer,
        *,
        clock: DeviceClock,
        n_channels: int,
        debounce_ns: int,
        put: Callable[[CountSamples | LatchedCounts], bool],
        fault: Callable[[str, str, str, int], None],
        counters: Counter[str],
    ) -> None:
        self._device, self._path, self._n_channels = device, path, n_channels
        self._edges, self._put, self._fault = edges, put, fault
        self._counters = counters
        self.clock = clock
        self._held: list[Callable[[], None]] = []
        self._last_ticks: int | None = None
        self._stream = self._request = 0
        self._sequence = StreamSequence()
        self._debounce_ns = debounce_ns
        # Number of the next edge, and ticks, unwrapped.
        self._heartbeat: tuple[int, int] | None = None
        # By number, with the times of their reads: those that overtook an earlier one.
        self._early: dict[int, tuple[wire.Edge, int]] = {}
        self._waiting_since_ns: int | None = None
        self._is_waiting_reported = False

    def begin_stream(self, stream: int, request: int) -> None:
        self._stream, self._request = stream, request
        self._sequence = StreamSequence()

    def take(
        self, message: wire.Message, received_ns: int, earlier: PartialReads = ()
    ) -> None:
        """Process messages about samples, edges and time, no others.

        Raises:
            DeviceError: the board has lost its stream.
        """
        match message:
            case wire.SampleBlock():
                self._take_samples(message, received_ns, earlier)
            case wire.Edge():
                self._take_edge(message, received_ns)
            case wire.Heartbeat():
                self._take_heartbeat(message, received_ns)
            case _:
                pass

    def take_latch(
        self, answer: wire.Latched, token: int, sent_ns: int, received_ns: int
    ) -> None:
        """Hand over a latch, whose request shows whether the counter stood still."""
        self.clock.update(self.clock.unwrap_one(answer.ticks), received_ns, sent_ns)
        if self._fits(answer.counts):
            self._deliver_latch(answer, None, token, received_ns)

    def _take_samples(
        self, block: wire.SampleBlock, received_ns: int, earlier: PartialReads
    ) -> None:
        """Hand over new samples of a block.

        Each read is one measurement of the delay; the clock uses the smallest of many.
        """
        counters, clock = self._counters, self.clock
        if block.request != self._request:
            counters["samples_of_old_stream"] += len(block.seq)
            return
        if not self._fits(block.counts[0]):
            return
        seq, kept, lost, dropped = self._sequence.accept(block.seq)
        counters["samples_repeated"] += dropped
        self._report_lost(lost)
        if not len(seq):
            return
        for row, at_ns in earlier:
            if row < len(block.ticks):
                clock.update(clock.unwrap_one(int(block.ticks[row])), at_ns)
        rows = slice(None) if kept is None else kept
        ticks = clock.unwrap(block.ticks[rows])
        self._check_order(ticks)
        if not earlier or earlier[-1][0] < len(block.ticks) - 1:
            clock.update(int(ticks[-1]), received_ns)
        counters["samples_received"] += len(seq)
        stream = self._stream
        is_unsure = clock.is_late or clock.lacks_answer
        if self._held or (is_unsure and len(self._held) < MAX_HELD):
            self._held.append(
                lambda: self._deliver(block, rows, (stream, seq, ticks), received_ns)
            )
        else:
            self._deliver(block, rows, (stream, seq, ticks), received_ns)

    def _check_order(self, ticks: Integers) -> None:
        """Compare a board's counter with its successive samples.

        Raises:
            DeviceError: it has gone back.
        """
        last = ticks[0] - 1 if self._last_ticks is None else self._last_ticks
        steps = np.diff(ticks, prepend=last)
        self._last_ticks = int(ticks[-1])
        if steps.min() <= 0:
            raise DeviceError(
                f"the counter of the board on {self._path} has gone back by "
                f"{-int(steps.min())} ticks while its samples go on: it is not 32 bits "
                "wide, or has begun anew",
                "let the firmware count 32 bits of ticks; check the board's power",
            )

    @property
    def holds(self) -> bool:
        """Whether samples wait for a check of the board's clock."""
        return bool(self._held)

    def release(self) -> None:
        """Hand over waiting samples, with their present times and doubts."""
        held, self._held = self._held, []
        for deliver in held:
            deliver()

    def _deliver(
        self,
        block: wire.SampleBlock,
        rows: slice | Booleans,
        numbered: tuple[int, Integers, Integers],
        received_ns: int,
    ) -> None:
        clock, (stream, seq, ticks) = self.clock, numbered
        # One that was held may be of before a step that was found meanwhile.
        is_before = clock.is_before_step(int(ticks[0]))
        self._put(
            CountSamples(
                self._device,
                stream,
                seq,
                ticks,
                received_ns,
                # A new smallest delay moves the clock gradually; none is below zero.
                np.minimum(clock.to_ns_array(ticks), received_ns),
                block.inputs[rows],
                block.counts[rows],
                _STATUS_ARRAY[block.status[rows]] | self._time_status(is_before),
                time_bound_ns=clock.error_bound_ns,
            )
        )

    def _take_edge(self, edge: wire.Edge, received_ns: int) -> None:
        """Hand over an edge in its turn.

        Raises:
            DeviceError: it is of another start of the board than the heartbeats.
        """
        clock = self.clock
        if not clock.running or (
            clock.is_uncertain and (clock.is_late or not edge.counts)
        ):
            self._wait_with_edges(received_ns)
            return  # the board sends it again; until then it has no time
        self._waiting_since_ns, self._is_waiting_reported = None, False
        if not self._fits(edge.counts):
            return
        verdict, lost = self._edges.classify(edge.seq, received_ns)
        if verdict == "early" and len(self._early) < MAX_EARLY:
            self._early[edge.seq] = edge, received_ns
        if lost:
            self._early = {
                seq: early
                for seq, early in self._early.items()
                if (seq - edge.seq) % WRAP < WRAP // 2
            }
            self._fault(
                "edges_lost",
                f"{lost} button or probe edges were lost on the board",
                "repeat the last points",
                lost,
            )
        if verdict != "next":
            return
        self._hand_over(edge, received_ns)
        # The board repeats those after a broken one as late as that one. In a burst the
        # next would be early then, and so on for as long as the burst lasts.
        while self._edges.expected in self._early:
            self._hand_over(*self._early[self._edges.expected])

    def _hand_over(self, edge: wire.Edge, received_ns: int) -> None:
        """Hand over the edge that is next.

        Raises:
            DeviceError: it is of another start of the board than the heartbeats.
        """
        self._early.pop(edge.seq, None)
        if self._is_of_another_start(edge):
            raise DeviceError(
                f"the board on {self._path} counts its edges anew",
                "check its power: it has probably been restarted",
            )
        # It was sent once it had held, a delay that the clock is not to learn from.
        held_ns = received_ns - self._debounce_ns
        ticks = self.clock.unwrap_one(edge.ticks)
        if self.clock.is_unusual(ticks, held_ns):
            self.clock.update(ticks, held_ns)
            return  # the board sends it again; by then the clock has been read anew
        # Noted before it is passed on: its acknowledgement may arrive at once.
        self._edges.mark_delivered(edge.seq)
        if self._deliver_latch(edge, edge.input, edge.seq, received_ns):
            self._counters["edges_received"] += 1
        else:
            self._edges.mark_refused(edge.seq)

    def _wait_with_edges(self, received_ns: int) -> None:
        """Report edges that wait long for the board's clock; nobody sees them yet."""
        if self._waiting_since_ns is None:
            self._waiting_since_ns = received_ns
        waited_ns = received_ns - self._waiting_since_ns
        if waited_ns > WAITING_NS and not self._is_waiting_reported:
            self._is_waiting_reported = True
            self._fault(
                "edges_waiting",
                f"presses wait on the board for more than {WAITING_NS * 1e-9:g} s: its "
                "clock is not known well enough to say when they were",
                "relieve this computer or the line, whose delays vary too much; the "
                "points come once the clock is known",
                1,
            )

    def _is_of_another_start(self, edge: wire.Edge) -> bool:
        """Return whether an edge precedes a heartbeat that did not have it.

        Strategy: a board that lost power begins its numbers and ticks again, and its
        first press may arrive before the heartbeat that shows it. Taken for an earlier
        edge, its counts would be read with zeros that were lost. An edge is numbered
        once it has held, so that a debounced one may precede by that time.
        """
        if self._heartbeat is None:
            return False
        n_edges, ticks = self._heartbeat
        is_newer = (edge.seq - n_edges) % WRAP < WRAP // 2
        before_ns = self.clock.to_ns(ticks) - self.clock.to_ns(
            self.clock.unwrap_one(edge.ticks)
        )
        return is_newer and before_ns > self._debounce_ns + NUMBERED_NS

    def _take_heartbeat(self, heartbeat: wire.Heartbeat, received_ns: int) -> None:
        clock, counters = self.clock, self._counters
        if self._request:  # a stream is running, as far as the board knows
            if not heartbeat.streaming:
                raise DeviceError(
                    f"the board on {self._path} has stopped its stream by itself",
                    "check its power: it has probably been restarted",
                )
            # It contains the next sample's number: those before have been sent.
            self._report_lost(self._sequence.reach(heartbeat.next_sample_seq))
        ticks = clock.unwrap_one(heartbeat.ticks)
        clock.update(ticks, received_ns)
        self._heartbeat = heartbeat.next_edge_seq, ticks
        first_edge = heartbeat.next_edge_seq - heartbeat.edges_back
        if (forgotten := self._edges.begin_at(first_edge)) > 0:
            self._fault(
                "edges_lost",
                f"the board forgot {counted(forgotten, 'button or probe edge')} of the "
                "time before this start; a press and its release are two",
                "look which points of that time are missing, and take them again",
                forgotten,
            )
        counters["board_tx_dropped"] = heartbeat.tx_dropped
        counters["board_rx_rejected"] = heartbeat.rx_rejected
        if (steps := clock.steps - counters["clock_steps"]) > 0:
            self._fault(
                "clock_stepped",
                "the board's counter, or the host's, has jumped; times of samples and "
                "points are uncertain until they are tied again",
                "check the board's power; take the last points again",
                steps,
            )
        counters["clock_steps"] = clock.steps

    def _time_status(self, is_before_step: bool) -> np.uint8:
        is_uncertain = is_before_step or self.clock.is_uncertain
        return np.uint8(STATUS_TIME_UNCERTAIN if is_uncertain else 0)

    def _deliver_latch(
        self,
        latch: wire.Edge | wire.Latched,
        number: int | None,
        token: int,
        received_ns: int,
    ) -> bool:
        clock = self.clock
        ticks = clock.unwrap_one(latch.ticks)
        bound_ns = clock.error_bound_ns
        is_ahead = clock.to_ns(ticks) - received_ns > max(bound_ns, LATCHED_AHEAD_NS)
        margin_ns = 0 if number is None else NOTICED_NS
        is_unknown = clock.is_before_step(ticks, margin_ns) or is_ahead
        time_status = int(self._time_status(is_unknown))
        if number is not None and clock.is_newer(ticks):
            # No reading since then denies that the counter stood still meanwhile.
            late_ns = received_ns - self._debounce_ns - clock.to_ns(ticks)
            bound_ns = max(bound_ns, late_ns)
        if time_status:  # which a board without joints has no place for
            bound_ns = max(bound_ns, round(UNKNOWN_NS))
        return self._put(
            LatchedCounts(
                self._device,
                number,
                isinstance(latch, wire.Latched) or latch.level != 0,
                token,
                ticks,
                received_ns,
                min(clock.to_ns(ticks), received_ns),
                latch.counts,
                tuple(
                    time_status | status
                    for status in bytes(latch.status).translate(_STATUS_BYTES)
                ),
                bound_ns,
            )
        )

    def _fits(self, counts: Sized) -> bool:
        """Return whether a latch has the channels of HELLO; else count it."""
        if len(counts) == self._n_channels:
            return True
        self._fault(
            "channels_changed",
            f"{counted(len(counts), 'channel')} in a frame of a board with "
            f"{self._n_channels}",
            "update the board's firmware",
            1,
        )
        return False

    def _report_lost(self, lost: int) -> None:
        if lost:
            self._fault(
                "samples_lost",
                f"{counted(lost, 'sample')} lost between board and host",
                "lower the rate, or use a faster line",
                lost,
            )

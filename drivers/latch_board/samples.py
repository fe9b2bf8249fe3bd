"""Timed samples of a latch board: numbered, given their times, handed over."""

import numpy as np

from traverse.drivers.base.values import STATUS_WARNING, CountSamples
from traverse.drivers.latch_board.line import PartialReads
from traverse.drivers.latch_board.report_sink import BoardReports
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.drivers.timing.stream_sequence import StreamSequence
from traverse.protocol import latch_board as wire

# The maker's own bits of a status byte warn of something; what, nobody else knows.
_MAKERS = 0xF0
STATUS = np.array(
    [s & ~_MAKERS | (STATUS_WARNING if s & _MAKERS else 0) for s in range(256)],
    dtype=np.uint8,
)
"""The status byte of the board, by value, in the words of all drivers."""


class BoardSamples:
    """The streams of one connection, one at a time.

    Args:
        clock: of the board.
        reports: where blocks and faults go.
    """

    def __init__(self, clock: DeviceClock, reports: BoardReports) -> None:
        self._clock, self._reports = clock, reports
        self._stream = self._request = 0
        self._sequence = StreamSequence()

    def begin(self, stream: int, request: int) -> None:
        """From now on those samples count that belong to this START."""
        self._stream, self._request = stream, request
        self._sequence = StreamSequence()

    def end(self) -> None:
        """The stream is to stop, or another to begin."""
        self._request = 0

    @property
    def streaming(self) -> bool:
        """A stream is under way, as far as the board has been told."""
        return self._request != 0

    def take(
        self,
        block: wire.SampleBlock,
        received_ns: int,
        earlier: PartialReads = (),
    ) -> None:
        """Hand over what is new in a block.

        Each read tells the clock of one delay, and the smallest of many is to be found.
        """
        counters = self._reports.counters
        if block.request != self._request:
            counters["samples_of_old_stream"] += len(block.seq)
            return
        if not self._reports.fits(block.counts[0]):
            return
        seq, kept, lost, dropped = self._sequence.accept(block.seq)
        counters["samples_repeated"] += dropped
        self._report_lost(lost)
        if not len(seq):
            return
        for row, at_ns in earlier:
            if row < len(block.ticks):
                self._clock.update(self._clock.unwrap_one(int(block.ticks[row])), at_ns)
        rows = slice(None) if kept is None else kept
        ticks = self._clock.unwrap(block.ticks[rows])
        self._clock.update(int(ticks[-1]), received_ns)
        counters["samples_received"] += len(seq)
        self._reports.put(
            CountSamples(
                self._reports.device,
                self._stream,
                seq,
                ticks,
                received_ns,
                # A new smallest delay moves the clock gradually; none is below zero.
                np.minimum(self._clock.to_ns_array(ticks), received_ns),
                block.inputs[rows],
                block.counts[rows],
                STATUS[block.status[rows]],
            )
        )

    def reach(self, next_seq: int) -> None:
        """The board says what its next sample is: those before have been sent."""
        self._report_lost(self._sequence.reach(next_seq))

    def _report_lost(self, lost: int) -> None:
        if lost:
            self._reports.fault(
                "samples_lost",
                f"{lost} samples lost between board and host",
                "lower the rate, or use a faster line",
                lost,
            )

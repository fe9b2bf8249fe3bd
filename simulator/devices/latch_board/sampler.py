"""Latches encoders: for the stream, for LATCH, for edges."""

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.simulator.devices.latch_board import wire
from traverse.simulator.devices.latch_board.inputs import InputLevels
from traverse.simulator.devices.latch_board.stream import Stream
from traverse.simulator.devices.latch_board.tick_counter import TickCounter
from traverse.simulator.scenario.signals import (
    InputChange,
    LatchedEdge,
    LatchSource,
    OutgoingFrame,
)

STREAM, ON_REQUEST = 0, 1  # causes of a sample


class Sampler:
    """What a board latches, and when.

    Attributes:
        next_seq: What the next sample of the stream carries.
        n_samples: Latched since power-up.
    """

    def __init__(
        self,
        tick_rate_hz: int,
        ticks: TickCounter,
        latched: LatchSource,
        inputs: InputLevels,
    ) -> None:
        self.next_seq = 0
        self.n_samples = 0
        self._tick_rate_hz = tick_rate_hz
        self._ticks = ticks
        self._latched = latched
        self._inputs = inputs
        self._stream: Stream | None = None

    @property
    def streaming(self) -> bool:
        """A timed stream runs."""
        return self._stream is not None

    def start(self, request: int, rate_millihz: int, now_s: float) -> None:
        """Begin a stream, in the place of another."""
        first_tick = self._ticks.at(now_s) + 1
        self._stream = Stream(request, rate_millihz, self._tick_rate_hz, first_tick)
        self.next_seq = 0

    def stop(self) -> None:
        """End the stream, if there is one."""
        self._stream = None

    def next_s(self) -> float:
        """When the next sample of the stream is latched; infinity without one."""
        if self._stream is None:
            return float("inf")
        return self._ticks.time_s(self._stream.next_tick())

    def until(self, to_s: float) -> list[OutgoingFrame]:
        """Latch the stream's samples up to a time."""
        if self._stream is None:
            return []
        seqs, ticks = self._stream.take_until(self._ticks.at(to_s))
        self.next_seq = self._stream.next_seq
        if len(seqs) == 0:
            return []
        times_s = self._ticks.times_s(ticks)
        return self._frames((STREAM, self._stream.request), seqs, ticks, times_s)

    def once(self, request: int, now_s: float) -> list[OutgoingFrame]:
        """Latch now, for a LATCH."""
        ticks = np.array([self._ticks.at(now_s)])
        seqs = np.zeros(1, dtype=np.int64)
        return self._frames((ON_REQUEST, request), seqs, ticks, np.array([now_s]))

    def edge(self, change: InputChange) -> LatchedEdge:
        """Latch at an edge, exactly at its time."""
        counts, status = self._latched.latch(np.array([change.time_s]), edge=True)
        return LatchedEdge(
            change.time_s,
            change.input_number,
            change.level,
            self._inputs.levels,
            self._ticks.shown(self._ticks.at(change.time_s)),
            counts[0],
            status[0],
        )

    def _frames(
        self,
        cause_and_request: tuple[int, int],
        seqs: Integers,
        ticks: Integers,
        times_s: Floats,
    ) -> list[OutgoingFrame]:
        counts, status = self._latched.latch(times_s, edge=False)
        shown = (ticks + self._ticks.first_ticks) & 0xFFFFFFFF
        frames = wire.samples(
            *cause_and_request,
            self._inputs.levels,
            seqs=(seqs & 0xFFFFFFFF).astype(np.uint32),
            ticks=shown.astype(np.uint32),
            counts=counts,
            status=status,
        )
        self.n_samples += len(frames)
        return [OutgoingFrame(True, frame) for frame in frames]

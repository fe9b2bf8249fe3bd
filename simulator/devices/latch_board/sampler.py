"""Latching of encoders: for the stream, for LATCH, for edges of inputs."""

import math
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.simulator.devices.latch_board import wire
from traverse.simulator.devices.wrong_clock import WrongClock
from traverse.simulator.scenario.signals import (
    InputChange,
    LatchedEdge,
    OutgoingFrame,
)
from traverse.simulator.scenario.wiring import Wiring

ROUNDING = 1e-6  # of a tick: `at` of `time_s` must be the same tick again


@dataclass(frozen=True, slots=True)
class TickCounter:
    """A counter in the units of true time.

    Ticks do not wrap, and are 0 at power-up; `shown` is the value in a frame.

    Attributes:
        power_up_s: true time of power-up.
    """

    rate_hz: int
    clock: WrongClock
    first_ticks: int
    power_up_s: float

    def at(self, time_s: float) -> int:
        shown_s = self.clock.shown_s(time_s - self.power_up_s)
        return math.floor(shown_s * self.rate_hz + ROUNDING)

    def time_s(self, ticks: int) -> float:
        return self.power_up_s + self.clock.true_s(ticks / self.rate_hz)

    def times_s(self, ticks: Integers) -> Floats:
        """Return the true times (n,) of ticks (n,)."""
        return self.power_up_s + self.clock.true_times_s(ticks / self.rate_hz)

    def shown(self, ticks: int) -> int:
        return (self.first_ticks + ticks) & 0xFFFFFFFF


class InputLevels:
    """Levels of inputs, present and debounced."""

    def __init__(self) -> None:
        self.levels = 0
        self._reported = 0
        self._watched: dict[int, tuple[float, LatchedEdge]] = {}

    def change(self, input_number: int, level: int, held_at_s: float) -> bool:
        """Take a new level; True if an edge begins that must be latched.

        A contact that bounces is at rest later; its edge is the first change.
        """
        bit = 1 << input_number
        self.levels = self.levels & ~bit | bit * level
        if input_number in self._watched:
            self._watched[input_number] = held_at_s, self._watched[input_number][1]
            return False
        return bool(self._reported & bit) != bool(level)

    def watch(self, edge: LatchedEdge, held_at_s: float) -> None:
        self._watched[edge.input_number] = (held_at_s, edge)

    def next_held_s(self) -> float:
        """Return when the next edge has held; infinity if none is watched."""
        times_s = (held_at_s for held_at_s, _ in self._watched.values())
        return min(times_s, default=float("inf"))

    def take_held(self, now_s: float) -> list[LatchedEdge]:
        """Return the edges that have held, in order of time."""
        held = [edge for at_s, edge in self._watched.values() if at_s <= now_s]
        for edge in held:
            del self._watched[edge.input_number]
        moved = [
            e for e in held if (self.levels ^ self._reported) >> e.input_number & 1
        ]
        for edge in moved:
            self._reported ^= 1 << edge.input_number
        return sorted(moved, key=lambda edge: edge.time_s)


@dataclass(slots=True)
class Stream:
    """A running stream; sample k is at first + round(k tick_rate 1000 / rate)."""

    request: int
    rate_millihz: int
    tick_rate_hz: int
    first_tick: int
    next_seq: int = 0

    def next_tick(self) -> int:
        return self.first_tick + self._offset(self.next_seq)

    def take_until(self, tick: int) -> tuple[Integers, Integers]:
        """Take the samples up to and including a tick.

        From round(k a / b) <= d follows k <= (b (2 d + 1) - 1) // (2 a).

        Returns:
            Sequence numbers and ticks (n,), both without wrap.
        """
        elapsed = tick - self.first_tick
        span = 1000 * self.tick_rate_hz
        last_seq = (self.rate_millihz * (2 * elapsed + 1) - 1) // (2 * span)
        first_seq = self.next_seq
        seqs = np.arange(first_seq, max(last_seq + 1, first_seq), dtype=np.int64)
        self.next_seq = first_seq + len(seqs)
        return seqs, self.first_tick + self._offsets(first_seq, len(seqs))

    def _offset(self, seq: int) -> int:
        return int(self._offsets(seq, 1)[0])

    def _offsets(self, first_seq: int, n_samples: int) -> Integers:
        # After rate_millihz samples exactly 1000 tick_rate_hz ticks have passed;
        # counting from there keeps the products below 2^63 for ever.
        span = 1000 * self.tick_rate_hz
        rounds, first_in_round = divmod(first_seq, self.rate_millihz)
        seqs = first_in_round + np.arange(n_samples, dtype=np.int64)
        twice = 2 * seqs * span + self.rate_millihz
        return rounds * span + twice // (2 * self.rate_millihz)


STREAM, ON_REQUEST = 0, 1  # causes of a sample


class Sampler:
    """Latched values of a board, with times."""

    def __init__(
        self,
        tick_rate_hz: int,
        ticks: TickCounter,
        latched: Wiring,
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
        return self._stream is not None

    def start(self, request: int, rate_millihz: int, now_s: float) -> None:
        first_tick = self._ticks.at(now_s) + 1
        self._stream = Stream(request, rate_millihz, self._tick_rate_hz, first_tick)
        self.next_seq = 0

    def stop(self) -> None:
        self._stream = None

    def next_s(self) -> float:
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
            change.event,
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

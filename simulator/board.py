"""The latching controller board: bytes in, frames out, time given from outside.

It implements docs/serial-protocol.md from the board's side. No port and no clock
here: `advance` moves the board's time, `receive` happens at a given time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simulator import wire
from simulator.edges import EdgeQueue, LatchedEdge
from simulator.stream import Stream
from simulator.ticks import TickCounter

DONE, UNKNOWN_REQUEST, WRONG_LENGTH, RATE_OUT_OF_RANGE = 0, 1, 2, 3
OTHER_MAJOR, OUT_OF_RANGE, NOT_NOW = 4, 5, 6
LONGEST_DEBOUNCE_US = 1_000_000
BOARD_ITSELF = 0xFF
FRAMES_DROPPED, EDGES_LOST = 6, 7
DROPPING_ENDS_S = 1.0  # so long without a loss, and alarm 6 is cleared


@dataclass(frozen=True, slots=True)
class InputChange:
    """An input takes a new level (1 active, 0 not)."""

    time_s: float
    input_number: int
    level: int


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """An encoder begins or ends to complain."""

    time_s: float
    channel: int
    state: int
    code: int
    value: int


class Latched(Protocol):
    """What the board is wired to."""

    def latch(
        self, times_s: NDArray[np.float64], edge: bool
    ) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
        """Counts and status (n, n_channels) at times (n,)."""

    def peek_change(self) -> InputChange | AlarmChange | None:
        """The change that comes next, if any is known yet."""

    def take_change(self) -> None:
        """Go on to the one after it."""


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame on its way out; only samples may be dropped."""

    is_sample: bool
    data: bytes


@dataclass(slots=True)
class Settings:
    """What CONFIGURE sets; the values of power-up."""

    edge_mask: int = 0xFF
    heartbeat_ms: int = 1000
    temperature_ms: int = 5000
    debounce_us: int = 5000


class Board:
    """One board from power-up on.

    Args:
        identity: What it says in HELLO.
        ticks: Its counter.
        latched: Its encoders and inputs.
        temperatures_c: What its sensors show, None for a missing one.
        power_up_s: Time of power-up.
        on_edge: Told of every edge with its sequence number when it is reported.
    """

    def __init__(
        self,
        identity: wire.Identity,
        ticks: TickCounter,
        latched: Latched,
        temperatures_c: Sequence[float | None],
        power_up_s: float,
        on_edge: Callable[[int, LatchedEdge], None],
    ) -> None:
        self.identity = identity
        self.edges = EdgeQueue()
        self.n_samples = 0
        self.tx_dropped = 0
        self._on_edge = on_edge
        self._rejected = 0
        self._segments = wire.Segments()
        self._ticks = ticks
        self._latched = latched
        self._temperatures_c = temperatures_c
        self._settings = Settings()
        self._now_s = power_up_s
        self._greeted = False
        self._refused = False
        self._stream: Stream | None = None
        self._next_sample_seq = 0
        self._inputs = 0  # levels now
        self._reported = 0  # levels after debouncing
        self._bouncing: dict[int, LatchedEdge] = {}
        self._alarm_seq = 0
        self._dropped_at_s: float | None = None
        self._losing_edges = False
        self._heartbeat_s = power_up_s
        self._temperature_s = power_up_s

    @property
    def streaming(self) -> bool:
        """A timed stream runs."""
        return self._stream is not None

    @property
    def rx_rejected(self) -> int:
        """Segments from the host that were no valid frame."""
        return self._rejected + self._segments.n_too_long

    def next_due_s(self) -> float:
        """When `advance` has something to do next, the stream apart."""
        return min(time_s for time_s, _ in self._agenda())

    def next_sample_s(self) -> float:
        """When the next sample of the stream is latched; infinity without one."""
        if self._stream is None:
            return float("inf")
        return self._ticks.time_s(self._stream.next_tick())

    def advance(self, to_s: float) -> list[Frame]:
        """Let the board live until a time, in order of events."""
        frames: list[Frame] = []
        while True:
            due_s, act = min(self._agenda(), key=lambda entry: entry[0])
            if due_s > to_s:
                break
            frames += self._samples(due_s)
            self._now_s = max(self._now_s, due_s)
            frames += [Frame(False, data) for data in act(due_s)]
        frames += self._samples(to_s)
        self._now_s = max(self._now_s, to_s)
        return frames

    def receive(self, received: bytes) -> list[Frame]:
        """Answer what the host sent, now."""
        frames: list[Frame] = []
        for segment in self._segments.feed(received):
            body = wire.body_of(segment)
            if body is None:
                self._rejected += 1
            else:
                frames += self._answer(body)
        return frames

    def lose_host(self) -> None:
        """The host let go of the line: a begun frame and the stream end."""
        self._segments.forget()
        self._stream = None

    def count_dropped(self, n_dropped: int) -> list[Frame]:
        """Count samples that the line did not take, and complain once."""
        self.tx_dropped += n_dropped
        begins = self._dropped_at_s is None
        self._dropped_at_s = self._now_s
        return [Frame(False, self._own_alarm(FRAMES_DROPPED, 1))] if begins else []

    def _agenda(self) -> list[tuple[float, Callable[[float], list[bytes]]]]:
        """What comes next of everything but samples: when, and what to do then."""
        agenda = [
            (self._heartbeat_s, self._beat),
            (self._temperature_s, self._show_temperatures),
            (self.edges.next_due_s(), self.edges.due_again),
        ]
        change = self._latched.peek_change()
        if change is not None:
            agenda.append((change.time_s, self._take_change))
        if self._bouncing:
            held_s = min(edge.held_at_s for edge in self._bouncing.values())
            agenda.append((held_s, self._report_held))
        if self._dropped_at_s is not None:
            ends_s = self._dropped_at_s + DROPPING_ENDS_S
            agenda.append((ends_s, self._end_dropping))
        return agenda

    def _samples(self, to_s: float) -> list[Frame]:
        """Latch what the stream asks for up to a time."""
        if self._stream is None:
            return []
        seqs, ticks = self._stream.take_until(self._ticks.at(to_s))
        if len(seqs) == 0:
            return []
        times_s = np.array([self._ticks.time_s(int(tick)) for tick in ticks])
        frames = self._sample_frames(0, self._stream.request, seqs, ticks, times_s)
        self._next_sample_seq = self._stream.next_seq
        return frames

    def _sample_frames(
        self,
        cause: int,
        request: int,
        seqs: NDArray[np.int64],
        ticks: NDArray[np.int64],
        times_s: NDArray[np.float64],
    ) -> list[Frame]:
        counts, status = self._latched.latch(times_s, edge=False)
        shown = (ticks + self._ticks.first_ticks) & 0xFFFFFFFF
        data = wire.samples(
            cause,
            request,
            self._inputs,
            (seqs & 0xFFFFFFFF).astype(np.uint32),
            shown.astype(np.uint32),
            counts,
            status,
        )
        self.n_samples += len(data)
        return [Frame(True, frame) for frame in data]

    def _beat(self, now_s: float) -> list[bytes]:
        period_s = 1e-3 * self._settings.heartbeat_ms
        self._heartbeat_s = now_s + period_s if period_s else float("inf")
        return [
            wire.heartbeat(
                int(self.streaming),
                self._inputs,
                self._shown(now_s),
                self._next_sample_seq,
                self.edges.next_seq,
                self.tx_dropped,
                self.rx_rejected,
            )
        ]

    def _show_temperatures(self, now_s: float) -> list[bytes]:
        period_s = 1e-3 * self._settings.temperature_ms
        self._temperature_s = now_s + period_s if period_s else float("inf")
        if not self._temperatures_c:
            return []
        return [wire.temperatures(self._shown(now_s), self._temperatures_c)]

    def _take_change(self, _now_s: float) -> list[bytes]:
        change = self._latched.peek_change()
        self._latched.take_change()
        if isinstance(change, AlarmChange):
            return [
                self._alarm(change.channel, change.state, change.code, change.value)
            ]
        if isinstance(change, InputChange):
            return self._take_level(change)
        return []

    def _take_level(self, change: InputChange) -> list[bytes]:
        bit = 1 << change.input_number
        self._inputs = self._inputs & ~bit | bit * change.level
        if self._bouncing.pop(change.input_number, None) is not None:
            return []  # back at the old level before it had held
        if bool(self._reported & bit) == bool(change.level):
            return []
        times_s = np.array([change.time_s])
        counts, status = self._latched.latch(times_s, edge=True)
        edge = LatchedEdge(
            change.time_s,
            change.input_number,
            change.level,
            self._inputs,
            self._shown(change.time_s),
            counts[0],
            status[0],
            change.time_s + 1e-6 * self._settings.debounce_us,
        )
        self._bouncing[change.input_number] = edge
        return []

    def _report_held(self, now_s: float) -> list[bytes]:
        data: list[bytes] = []
        held = [edge for edge in self._bouncing.values() if edge.held_at_s <= now_s]
        for edge in sorted(held, key=lambda edge: edge.time_s):
            del self._bouncing[edge.input_number]
            self._reported ^= 1 << edge.input_number
            if self._settings.edge_mask >> edge.input_number & 1:
                data += self._report(edge, now_s)
        return data

    def _report(self, edge: LatchedEdge, now_s: float) -> list[bytes]:
        seq, room = self.edges.take_seq()
        self._on_edge(seq, edge)
        if not room:
            self._losing_edges = True
            return [self._own_alarm(EDGES_LOST, 1)]
        data = wire.edge(
            edge.input_number,
            edge.level,
            edge.inputs,
            seq & 0xFFFFFFFF,
            edge.ticks,
            edge.counts,
            edge.status,
        )
        self.edges.keep(seq, data, now_s)
        return [data]

    def _end_dropping(self, _now_s: float) -> list[bytes]:
        self._dropped_at_s = None
        return [self._own_alarm(FRAMES_DROPPED, 0)]

    def _own_alarm(self, code: int, state: int) -> bytes:
        n_lost = self.tx_dropped if code == FRAMES_DROPPED else self.edges.n_lost
        return self._alarm(BOARD_ITSELF, state, code, min(n_lost, 0x7FFFFFFF))

    def _alarm(self, channel: int, state: int, code: int, value: int) -> bytes:
        seq, self._alarm_seq = self._alarm_seq, self._alarm_seq + 1
        return wire.alarm(channel, state, code, seq, self._shown(self._now_s), value)

    def _shown(self, time_s: float) -> int:
        return self._ticks.shown(self._ticks.at(time_s))

    def _answer(self, body: bytes) -> list[Frame]:
        kind, fields = body[0], body[1:]
        layout = wire.REQUEST_FIELDS.get(kind)
        if layout is None or len(fields) != layout.size:
            self._rejected += 1
            asks = kind < wire.BOARD_TYPES and kind != wire.EDGE_ACK and fields
            if not asks or self._refused:
                return []
            result = UNKNOWN_REQUEST if layout is None else WRONG_LENGTH
            return [Frame(False, wire.reply(kind, fields[0], result, 0))]
        values = layout.unpack(fields)
        if kind == wire.HELLO:
            return [Frame(False, self._greet(*values))]
        if self._refused:
            return []
        if kind == wire.EDGE_ACK:
            return self._acknowledge(values[0])
        if not self._greeted:
            return [Frame(False, wire.reply(kind, values[0], NOT_NOW, 0))]
        if kind == wire.LATCH:
            return self._latch_once(values[0])
        result, value = self._set(kind, values)
        return [Frame(False, wire.reply(kind, values[0], result, value))]

    def _greet(self, request: int, major: int, flags: int) -> bytes:
        self._stream = None
        self._refused = major != wire.MAJOR
        if self._refused:
            return wire.reply(wire.HELLO, request, OTHER_MAJOR, wire.MAJOR)
        self._greeted = True
        if flags & 1:
            self.edges.forget()
            self._losing_edges = False
        return wire.hello(request, self.identity)

    def _acknowledge(self, seq: int) -> list[Frame]:
        self.edges.acknowledge(seq)
        if not self._losing_edges or len(self.edges):
            return []
        self._losing_edges = False
        return [Frame(False, self._own_alarm(EDGES_LOST, 0))]

    def _latch_once(self, request: int) -> list[Frame]:
        ticks = np.array([self._ticks.at(self._now_s)])
        times_s = np.array([self._now_s])
        return self._sample_frames(1, request, np.zeros(1, np.int64), ticks, times_s)

    def _set(self, kind: int, values: tuple[int, ...]) -> tuple[int, int]:
        """Set what CONFIGURE, START or STOP ask for; result and value of the REPLY."""
        if kind == wire.CONFIGURE:
            settings = Settings(*values[1:])
            if settings.debounce_us > LONGEST_DEBOUNCE_US:
                return OUT_OF_RANGE, 0
            self._settings = settings
            self._heartbeat_s = self._next_s(settings.heartbeat_ms)
            self._temperature_s = self._next_s(settings.temperature_ms)
        elif kind == wire.START:
            rate_millihz, most = values[1], self.identity.max_rate_millihz
            if not 0 < rate_millihz <= most:
                return RATE_OUT_OF_RANGE, most
            self._stream = Stream(
                values[0],
                rate_millihz,
                self.identity.tick_rate_hz,
                self._ticks.at(self._now_s) + 1,
            )
            self._next_sample_seq = 0
            return DONE, rate_millihz
        else:
            self._stream = None
        return DONE, 0

    def _next_s(self, period_ms: int) -> float:
        return self._now_s + 1e-3 * period_ms if period_ms else float("inf")

"""The latching controller board: bytes in, frames out, time set by the caller.

It implements docs/serial-protocol.md from the board's side, without port and clock:
`advance` moves the board's time, `receive` happens at a given time.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.simulator.devices.latch_board import wire
from traverse.simulator.devices.latch_board.sampler import (
    InputLevels,
    Sampler,
    TickCounter,
)
from traverse.simulator.scenario.signals import (
    AlarmChange,
    InputChange,
    LatchedEdge,
    OutgoingFrame,
)
from traverse.simulator.scenario.wiring import Wiring

AGAIN_AFTER_S = 0.050
MOST_WAITING = 16


@dataclass(slots=True)
class _Waiting:
    seq: int
    data: bytes
    sent_s: float


class EdgeQueue:
    """Edges sent and not yet acknowledged, at most 16."""

    def __init__(self) -> None:
        self.next_seq = 0
        self.n_lost = 0
        self._waiting: deque[_Waiting] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def back(self) -> int:
        """Next number minus the oldest waiting edge's; 0 if none waits."""
        return min(255, self.next_seq - self._waiting[0].seq) if self._waiting else 0

    def report(self, edge: LatchedEdge, now_s: float) -> bytes | None:
        """Store an edge and return its frame; None if there is no room."""
        seq, self.next_seq = self.next_seq, self.next_seq + 1
        if len(self._waiting) >= MOST_WAITING:
            self.n_lost += 1
            return None
        data = wire.edge(
            edge.input_number,
            edge.level,
            edge.inputs,
            seq=seq & 0xFFFFFFFF,
            ticks=edge.ticks,
            counts=edge.counts,
            status=edge.status,
        )
        self._waiting.append(_Waiting(seq, data, now_s))
        return data

    def acknowledge(self, seq_shown: int) -> None:
        """Drop every edge up to and including the one with these 32 bits.

        A number that was not yet given is of another start of the board.
        """
        if (self.next_seq - 1 - seq_shown) & 0xFFFFFFFF >= 0x80000000:
            return
        while self._waiting:
            age = (seq_shown - self._waiting[0].seq) & 0xFFFFFFFF
            if age >= 0x80000000:
                break
            self._waiting.popleft()

    def forget(self) -> None:
        self._waiting.clear()

    def next_due_s(self) -> float:
        due_s = min((entry.sent_s for entry in self._waiting), default=float("inf"))
        return due_s + AGAIN_AFTER_S

    def due_again(self, now_s: float) -> list[bytes]:
        """Return those to be sent again now, oldest first."""
        due = [e for e in self._waiting if e.sent_s + AGAIN_AFTER_S <= now_s]
        for entry in due:
            entry.sent_s = now_s
        return [entry.data for entry in due]


DONE, UNKNOWN_REQUEST, WRONG_LENGTH, RATE_OUT_OF_RANGE = 0, 1, 2, 3
OTHER_MAJOR, OUT_OF_RANGE, NOT_NOW = 4, 5, 6
LONGEST_DEBOUNCE_US = 1_000_000


@dataclass(frozen=True, slots=True)
class Settings:
    """The fields of CONFIGURE, with the values of power-up as defaults."""

    edge_mask: int = 0xFF
    heartbeat_ms: int = 1000
    temperature_ms: int = 5000
    debounce_us: int = 5000


BOARD_ITSELF = 0xFF
FRAMES_DROPPED, EDGES_LOST = 6, 7
DROPPING_ENDS_S = 1.0  # so long without a loss, and the alarm is cleared


class Alarms:
    """Encodes alarms and remembers which of the board's own are raised."""

    def __init__(self, ticks: TickCounter) -> None:
        self.tx_dropped = 0
        self._ticks = ticks
        self._next_seq = 0
        self._dropped_at_s: float | None = None
        self._losing_edges = False

    def of_encoder(self, change: AlarmChange) -> bytes:
        at_s = change.time_s
        return self._write(
            at_s, change.channel, change.state, change.code, change.value
        )

    def drop(self, n_dropped: int, now_s: float) -> list[bytes]:
        """Count dropped samples; raise the alarm at the first."""
        self.tx_dropped += n_dropped
        begins = self._dropped_at_s is None
        self._dropped_at_s = now_s
        return [self._of_frames(1, now_s)] if begins else []

    def next_due_s(self) -> float:
        """Return when dropping counts as over; infinity if nothing is dropped."""
        if self._dropped_at_s is None:
            return float("inf")
        return self._dropped_at_s + DROPPING_ENDS_S

    def end_dropping(self, now_s: float) -> list[bytes]:
        self._dropped_at_s = None
        return [self._of_frames(0, now_s)]

    def lose_edge(self, n_lost: int, now_s: float) -> bytes:
        self._losing_edges = True
        return self._write(now_s, BOARD_ITSELF, 1, EDGES_LOST, n_lost)

    def end_losing_edges(self, n_lost: int, now_s: float) -> list[bytes]:
        """Clear the alarm, if it is raised: no edge waits."""
        if not self._losing_edges:
            return []
        self._losing_edges = False
        return [self._write(now_s, BOARD_ITSELF, 0, EDGES_LOST, n_lost)]

    def _of_frames(self, state: int, now_s: float) -> bytes:
        return self._write(now_s, BOARD_ITSELF, state, FRAMES_DROPPED, self.tx_dropped)

    def _write(
        self, now_s: float, channel: int, state: int, code: int, value: int
    ) -> bytes:
        seq, self._next_seq = self._next_seq, self._next_seq + 1
        ticks = self._ticks.shown(self._ticks.at(now_s))
        shown = min(value, 0x7FFFFFFF)
        return wire.alarm(channel, state, code, seq=seq, ticks=ticks, value=shown)


class Board:
    """One board from power-up on.

    A sensor shows ``warming_c(t)`` more at t than at first, a missing one None.
    ``on_edge`` takes every reported edge and its sequence number.
    """

    def __init__(
        self,
        identity: wire.Identity,
        ticks: TickCounter,
        latched: Wiring,
        *,
        temperatures_c: Sequence[float | None],
        power_up_s: float,
        on_edge: Callable[[int, LatchedEdge], None],
        warming_c: Callable[[float], float] = lambda _now_s: 0.0,
    ) -> None:
        self.identity = identity
        self.edges = EdgeQueue()
        self.alarms = Alarms(ticks)
        self._on_edge = on_edge
        self._rejected = 0
        self._segments = wire.Segments()
        self._ticks = ticks
        self._latched = latched
        self._temperatures_c = temperatures_c
        self._warming_c = warming_c
        self._settings = Settings()
        self._now_s = power_up_s
        self._greeted = False
        self._refused = False
        self._inputs = InputLevels()
        self.sampler = Sampler(identity.tick_rate_hz, ticks, latched, self._inputs)
        self._heartbeat_s = power_up_s
        self._temperature_s = power_up_s

    @property
    def streaming(self) -> bool:
        return self.sampler.streaming

    @property
    def rx_rejected(self) -> int:
        """Segments from the host that were no valid frame."""
        return self._rejected + self._segments.n_too_long

    def next_due_s(self) -> float:
        """Return when `advance` has something to do, samples apart."""
        return min(time_s for time_s, _ in self._agenda())

    def advance(self, to_s: float) -> list[OutgoingFrame]:
        frames: list[OutgoingFrame] = []
        while True:
            due_s, act = min(self._agenda(), key=lambda entry: entry[0])
            if due_s > to_s:
                break
            frames += self.sampler.until(due_s)
            self._now_s = max(self._now_s, due_s)
            frames += [OutgoingFrame(False, data) for data in act(due_s)]
        frames += self.sampler.until(to_s)
        self._now_s = max(self._now_s, to_s)
        return frames

    def receive(self, received: bytes) -> list[OutgoingFrame]:
        frames: list[OutgoingFrame] = []
        for segment in self._segments.feed(received):
            body = wire.body_of(segment)
            if body is None:
                self._rejected += 1
            else:
                frames += self._answer(body)
        return frames

    def lose_host(self) -> None:
        self._segments.forget()
        self.sampler.stop()

    def count_dropped(self, n_dropped: int) -> list[OutgoingFrame]:
        """Count samples that the line did not take, and complain once."""
        alarms = self.alarms.drop(n_dropped, self._now_s)
        return [OutgoingFrame(False, data) for data in alarms]

    def _agenda(self) -> list[tuple[float, Callable[[float], list[bytes]]]]:
        """Return the next events but samples: when, and the action."""
        agenda: list[tuple[float, Callable[[float], list[bytes]]]] = [
            (self._heartbeat_s, self._beat),
            (self._temperature_s, self._show_temperatures),
            (self.edges.next_due_s(), self.edges.due_again),
            (self._inputs.next_held_s(), self._report_held),
            (self.alarms.next_due_s(), self.alarms.end_dropping),
        ]
        change = self._latched.peek_change()
        if change is not None:
            agenda.append((change.time_s, self._take_change))
        return agenda

    def _beat(self, now_s: float) -> list[bytes]:
        period_s = 1e-3 * self._settings.heartbeat_ms
        self._heartbeat_s = now_s + period_s if period_s else float("inf")
        return [
            wire.heartbeat(
                int(self.streaming),
                self._inputs.levels,
                self._shown(now_s),
                edges_back=self.edges.back,
                next_sample_seq=self.sampler.next_seq,
                next_edge_seq=self.edges.next_seq,
                tx_dropped=self.alarms.tx_dropped,
                rx_rejected=self.rx_rejected,
            )
        ]

    def _show_temperatures(self, now_s: float) -> list[bytes]:
        period_s = 1e-3 * self._settings.temperature_ms
        self._temperature_s = now_s + period_s if period_s else float("inf")
        if not self._temperatures_c:
            return []
        warmer_c = self._warming_c(now_s)
        shown_c = [None if c is None else c + warmer_c for c in self._temperatures_c]
        return [wire.temperatures(self._shown(now_s), shown_c)]

    def _take_change(self, _now_s: float) -> list[bytes]:
        change = self._latched.peek_change()
        self._latched.take_change()
        if isinstance(change, AlarmChange):
            return [self.alarms.of_encoder(change)]
        if isinstance(change, InputChange):
            held_at_s = change.time_s + 1e-6 * self._settings.debounce_us
            if self._inputs.change(change.input_number, change.level, held_at_s):
                self._inputs.watch(self.sampler.edge(change), held_at_s)
        return []

    def _report_held(self, now_s: float) -> list[bytes]:
        data: list[bytes] = []
        for edge in self._inputs.take_held(now_s):
            if self._settings.edge_mask >> edge.input_number & 1:
                self._on_edge(self.edges.next_seq, edge)
                kept = self.edges.report(edge, now_s)
                data.append(kept or self.alarms.lose_edge(self.edges.n_lost, now_s))
        return data

    def _shown(self, time_s: float) -> int:
        return self._ticks.shown(self._ticks.at(time_s))

    def _answer(self, body: bytes) -> list[OutgoingFrame]:
        kind, fields = body[0], body[1:]
        layout = wire.REQUEST_FIELDS.get(kind)
        if layout is None or len(fields) != layout.size:
            self._rejected += 1
            result = UNKNOWN_REQUEST if layout is None else WRONG_LENGTH
            asks = kind < wire.BOARD_TYPES and kind != wire.EDGE_ACK and fields
            if not asks or self._refused:
                return []
            return [OutgoingFrame(False, wire.reply(kind, fields[0], result, 0))]
        values = layout.unpack(fields)
        if kind == wire.HELLO:
            return [OutgoingFrame(False, self._greet(*values)), *self._cleared()]
        return [] if self._refused else self._obey(kind, values)

    def _obey(self, kind: int, values: tuple[int, ...]) -> list[OutgoingFrame]:
        if kind == wire.EDGE_ACK:
            return self._acknowledge(values[0])
        if not self._greeted:
            return [OutgoingFrame(False, wire.reply(kind, values[0], NOT_NOW, 0))]
        if kind == wire.LATCH:
            return self.sampler.once(values[0], self._now_s)
        result, value = self._set(kind, values)
        return [OutgoingFrame(False, wire.reply(kind, values[0], result, value))]

    def _greet(self, request: int, major: int, flags: int) -> bytes:
        self.sampler.stop()
        self._refused = major != wire.MAJOR
        if self._refused:
            return wire.reply(wire.HELLO, request, OTHER_MAJOR, wire.MAJOR)
        self._greeted = True
        if flags & 1:
            self.edges.forget()
        return wire.hello(request, self.identity)

    def _acknowledge(self, seq: int) -> list[OutgoingFrame]:
        self.edges.acknowledge(seq)
        return self._cleared()

    def _cleared(self) -> list[OutgoingFrame]:
        if len(self.edges):
            return []
        cleared = self.alarms.end_losing_edges(self.edges.n_lost, self._now_s)
        return [OutgoingFrame(False, data) for data in cleared]

    def _set(self, kind: int, values: tuple[int, ...]) -> tuple[int, int]:
        """Apply CONFIGURE, START or STOP; return result and value of the REPLY."""
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
            self.sampler.start(values[0], rate_millihz, self._now_s)
            return DONE, rate_millihz
        else:
            self.sampler.stop()
        return DONE, 0

    def _next_s(self, period_ms: int) -> float:
        return self._now_s + 1e-3 * period_ms if period_ms else float("inf")

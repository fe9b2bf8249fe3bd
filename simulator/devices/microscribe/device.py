"""A MicroScribe on a serial line: box, encoders on the virtual arm, pedals.

Buttons, timer and all encoders are latched at one instant: on arrival of the request,
or at the polls of a report of motion. Its own table is the configuration's, which
must describe the arm of the arm file.
"""

import struct
import termios
from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from traverse.arrays import Integers
from traverse.plurals import counted
from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.microscribe import box as wire
from traverse.simulator.devices.serial_device import SerialDevice
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.devices.wrong_clock import ClockTable, WrongClock
from traverse.strict_toml.reader import StrictModel

MOST_COUNTS = 16384
Six = tuple[int, int, int, int, int, int]
BAUD_RATES = {
    termios.B9600: 9600,
    termios.B19200: 19200,
    termios.B38400: 38400,
    termios.B57600: 57600,
    termios.B115200: 115200,
}


class GeometryTable(StrictModel):
    """The table that the arm stores: six modified rows in its own units.

    Attributes:
        alpha: in 1/32768 of a half turn.
        a: in 1/1000 inch.
        d: in 1/1000 inch.
        beta: rotation about y at joint 3, in the units of `alpha`; an arm that has
            one has "Beta" in its comment.
    """

    alpha: Six
    a: Six
    d: Six
    beta: int | None = None

    @model_validator(mode="after")
    def _check_words(self) -> "GeometryTable":
        for word in (*self.alpha, *self.a, *self.d, self.beta or 0):
            if not -32768 <= word <= 32767:
                raise ValueError(f"{word} does not fit; expected -32768 to 32767")
        return self

    @property
    def block(self) -> bytes:
        block = struct.pack(">18h", *self.alpha, *self.a, *self.d)
        return block if self.beta is None else block + struct.pack(">h", self.beta)


class MicroscribeTable(SerialTable):
    """A MicroScribe on a serial line.

    Attributes:
        hci: version of its protocol.
        pedals: inputs on bit 0, 1, ... of the buttons: right, left.
        home: counts at the home position.
        first_ticks: of the timer at power-up.
    """

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS - {"status"} | {
        "cut",
        "unread",
    }
    BY_CHANNEL: ClassVar[bool] = False
    MOST_CHANNELS: ClassVar[int] = 8

    port: str = Field(min_length=1)
    hci: Literal[2, 3] = 2
    product: str = Field(default="MicroScribe 3D", max_length=60)
    model: str = Field(default="3DX", max_length=60)
    serial: str = Field(default="10001", max_length=60)
    comment: str = Field(default="", max_length=60)
    geometry: GeometryTable | None = None
    home: Six = (0, 0, 0, 0, 0, 0)
    pedals: tuple[Literal["button", "switch"], ...] = Field(
        default=("button", "switch"), max_length=7
    )
    timer_rate_hz: float = Field(default=1000.0, gt=0.0, le=100_000.0)
    clock_error_ppm: float = Field(default=0.0, ge=-300_000.0, le=300_000.0)
    clock: ClockTable = ClockTable()
    first_ticks: int = Field(default=0, ge=0, lt=MOST_COUNTS)

    def plate(self, moduli: Integers) -> wire.Nameplate:
        """Return the identity of the box with encoders of so many counts."""
        beta = self.geometry is not None and self.geometry.beta is not None
        comment = f"{self.comment} Beta".strip() if beta else self.comment
        texts = {
            wire.PRODUCT: self.product,
            wire.PRODUCT_ID: "IBOX",
            wire.MODEL: self.model,
            wire.SERIAL: self.serial,
            wire.COMMENT: comment,
            wire.FORMAT: "none" if self.geometry is None else "Format DH0.5",
            wire.VERSION: f"HCI {self.hci}.0",
        }
        return wire.Nameplate(
            self.hci,
            {command: text.encode("latin-1") for command, text in texts.items()},
            b"" if self.geometry is None else self.geometry.block,
            self.home,
            tuple(int(m) - 1 for m in moduli),
        )

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders."""
        most = wire.ENCODERS[self.hci][3]
        if len(counts_per_turn) > most:
            text = (
                f"{self.hci} has at most {counted(most, 'encoder')}; the arm file has "
            )
            yield "hci", f"{text}{len(counts_per_turn)} here"
        for channel, counts in enumerate(counts_per_turn):
            if counts > MOST_COUNTS:
                text = f"channel {channel} has {counts} counts per turn in the arm file"
                yield "id", f"{text}; a packet holds 14 bits, {MOST_COUNTS}"
        if self.encoder_turns != 1:
            yield "encoder_turns", "expected 1: the counts of an arm wrap at a turn"


class SimulatedMicroscribe(SerialDevice):
    """The arm."""

    def __init__(self, table: MicroscribeTable, mounting: DeviceContext) -> None:
        self._moduli = mounting.encoders.moduli
        self._plate = table.plate(self._moduli)
        self._tick_rate_hz = table.timer_rate_hz
        self._clock = WrongClock(table.clock, table.clock_error_ppm)
        self._first_ticks = table.first_ticks
        super().__init__(table, mounting, [table.port], table.pedals)

    def power_up(self, now_s: float) -> None:
        """Wait for a host; count from the present position."""
        self._box = wire.HciBox(self._plate, self._state_at, self._go_home)
        self._power_up_s = now_s
        self._offsets = np.zeros_like(self._moduli)
        self.levels = 0
        self._next_look_s = float("inf")
        self._sent: wire.State | None = None

    @property
    def streaming(self) -> bool:
        return self._box.report is not None

    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        if self.mounting.struck("reset", at_s):
            return
        before = self._box.report
        baud_rate = BAUD_RATES.get(self._lines[0].port.host_speed, 0)
        answer = self._box.receive_byte(byte, at_s, baud_rate)
        if self._box.report is not before:
            self._sent = None
            report = self._box.report
            self._next_look_s = float("inf") if report is None else at_s
        if answer:
            self.say(line, answer, at_s)

    def advance(self, to_s: float) -> None:
        if self.mounting.struck("reset", to_s):
            self.power_up(to_s)
        while (report := self._box.report) and (at_s := self._next_look_s) <= to_s:
            self._next_look_s = at_s + report.delay_s
            state = self._state_at(at_s, report.command)
            if self._has_changed(state, report):
                self._sent = state
                self.say(0, self._box.packet(report.command, state), at_s)

    def own_due_s(self) -> float:
        return self._next_look_s

    def _has_changed(self, state: wire.State, report: wire.Report) -> bool:
        if self._sent is None:
            self._sent = state
            return False
        if (state.buttons ^ self._sent.buttons) & report.buttons:
            return True
        return any(
            abs(now - before) >= delta
            for now, before, delta in zip(
                state.counts, self._sent.counts, report.deltas, strict=False
            )
        )

    def _go_home(self, at_s: float) -> None:
        home = np.array(self._plate.home[: len(self._moduli)])
        self._offsets[: len(home)] += (
            home - np.array(self._state_at(at_s, 0).counts)[:6]
        )

    def _state_at(self, at_s: float, command: int) -> wire.State:
        """Latch everything; edges of pedals belong to the packet that shows them."""
        if command & wire.ALL_ENCODERS:
            self.mounting.clock.begin(at_s)
        latched, status = self.wiring.latch(np.array([at_s]), edge=False)
        counts = (latched[0].astype(np.int64) + self._offsets) % self._moduli
        self.n_readings += 1
        for channel, count in enumerate(counts.tolist()):
            self.mounting.notes.reading(self.id, channel, at_s, count, 0)
        shown_s = self._clock.shown_s(at_s - self._power_up_s)
        ticks = self._first_ticks + int(shown_s * self._tick_rate_hz)
        self.report_edges(at_s, ticks, counts.astype(np.uint32), status[0])
        ticks %= wire.GREATEST_TIMER + 1
        return wire.State(self.levels, ticks, tuple(counts.tolist()))

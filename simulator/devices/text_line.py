"""A board that prints a line of text for each reading of all joints.

Forms of lines, written from output of open arms' firmware:

- ``toy-department``: "POS,<ms>,<x>,<y>,<z>,<deg>,..." once "START" was received; the
  coordinates are 0 here.
- ``bl-shopwork``: "   *** E0: <deg>,  E1: <deg>, ...", the lines that its firmware
  has as a comment.
- ``sketch``: "$TRV,<number>,<ms>,<counts>,...,<buttons>*<hh>"
  of the sketch in examples.
"""

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.serial_device import SerialDevice
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.devices.wrong_clock import ClockTable, WrongClock


class TextLineTable(SerialTable):
    """A board that prints lines; only a ``sketch`` prints buttons, on bit 0, 1, ..."""

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS - {"status", "late"} | {
        "cut",
        "unread",
    }
    BY_CHANNEL: ClassVar[bool] = False

    port: str = Field(min_length=1)
    form: Literal["toy-department", "bl-shopwork", "sketch"] = "sketch"
    rate_hz: float = Field(default=100.0, ge=1.0, le=2000.0)
    clock: ClockTable = ClockTable()
    buttons: tuple[Literal["button", "switch"], ...] = Field(
        default=("button", "switch"), max_length=8
    )


class SimulatedTextLine(SerialDevice):
    """The board."""

    def __init__(self, table: TextLineTable, mounting: DeviceContext) -> None:
        self._form = table.form
        self._period_s = 1.0 / table.rate_hz
        self._clock = WrongClock(table.clock)
        self._per_turn = mounting.encoders.moduli
        super().__init__(table, mounting, [table.port], table.buttons)

    def power_up(self, now_s: float) -> None:
        """Restart lines and time at zero; a ``toy-department`` waits for its start."""
        self._power_up_s = now_s
        self._n_lines = self.levels = 0
        self._next_s = now_s if self._form != "toy-department" else float("inf")
        self._command = bytearray()

    @property
    def streaming(self) -> bool:
        return self._next_s < float("inf")

    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        del line
        if byte not in b"\r\n":
            self._command += bytes([byte]) if len(self._command) < 64 else b""
            return
        command, self._command = bytes(self._command).upper(), bytearray()
        if self._form != "toy-department" or not command:
            return
        if command == b"START":
            self._next_s = at_s
            self.say(0, b"ACK,RECORDING_STARTED\r\n", at_s)
        else:
            self.n_rejected += 1
            self.say(0, b"ERROR,Unknown command: " + command + b"\r\n", at_s)

    def advance(self, to_s: float) -> None:
        """Print the due lines; begin anew after a reset."""
        while self._next_s <= to_s:
            at_s = self._next_s
            self._next_s = at_s + self._period_s
            self.say(0, self._line(at_s), at_s)
        if self.mounting.struck("reset", to_s):
            self.power_up(to_s)

    def own_due_s(self) -> float:
        return self._next_s

    def _line(self, at_s: float) -> bytes:
        if self._lines[
            0
        ].port.held:  # a board that nobody listens to prints all the same
            self.mounting.clock.begin(at_s)
        latched, status = self.wiring.latch(np.array([at_s]), edge=False)
        self.n_readings += 1
        ms = int(self._clock.shown_s(at_s - self._power_up_s) * 1000.0 + 1e-6)
        self.report_edges(at_s, ms, latched[0], status[0])
        counts: Sequence[int] = latched[0].tolist()
        for channel, count in enumerate(counts):
            self.mounting.notes.reading(self.id, channel, at_s, count, 0)
        degrees = [
            f"{360.0 * count / per_turn:.2f}"
            for count, per_turn in zip(counts, self._per_turn, strict=True)
        ]
        self._n_lines += 1
        if self._form == "toy-department":
            line = ",".join(["POS", str(ms), "0.000", "0.000", "0.000", *degrees])
        elif self._form == "bl-shopwork":
            named = [f"E{number}: {word}" for number, word in enumerate(degrees)]
            line = "   *** " + ",  ".join(named)
        else:
            words = [self._n_lines - 1, ms, *counts, self.levels]
            body = "TRV," + ",".join(map(str, words))
            check = 0
            for byte in body.encode():
                check ^= byte
            line = f"${body}*{check:02X}"
        return line.encode() + b"\r\n"

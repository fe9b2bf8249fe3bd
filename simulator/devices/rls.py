"""RLS Orbis and AksIM encoders, each on a serial line of its own.

Written from the makers' protocol as data sheets quote it. A request is one byte; the
answer repeats it (but for "3"), then two bytes of turns if they are counted, then
position and status bits left-aligned in two or three bytes, error and warning lowest
and 0 when they apply. "d" adds a byte of conditions, "t" tenths of a degree.

After CD EF 89 AB one setting follows; all these bytes are echoed and need 1 ms between
them. "T" sets up the continuous mode, "S" starts it, "P" stops it; no other setting is
simulated. Positions are latched when the request has arrived, or when an answer is due.
"""

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.serial_device import SerialDevice
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.scenario.faults import StatusFault

UNLOCK = b"\xcd\xef\x89\xab"
ARGUMENTS = {ord("T"): 4, ord("S"): 0, ord("P"): 0}
BETWEEN_S = 0.001  # two bytes of a setting
ERROR, WARNING = 1, 2  # status bits of the wiring


class RlsTable(SerialTable):
    """Encoders on UARTs or RS-422 lines, one on each port.

    Attributes:
        ports: channel i is the encoder on port i.
        temperature_c: of the encoders at the start; it follows the climate.
        clock_error_ppm: of the continuous mode's period.
    """

    MOST_CHANNELS: ClassVar[int] = 16

    ports: tuple[str, ...] = Field(min_length=1, max_length=16)
    bits: int = Field(default=14, ge=10, le=22)
    temperature_c: float = Field(default=30.0, ge=-40.0, le=125.0)
    clock_error_ppm: float = Field(default=0.0, ge=-10_000.0, le=10_000.0)

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders on these ports."""
        yield from self.number_problems("ports", len(counts_per_turn))
        multi_turn = min(65536, 2 ** (32 - self.bits))
        yield from self.bit_problems(self.bits, multi_turn, counts_per_turn)


class _Port:
    """State of an encoder from earlier commands."""

    def __init__(self) -> None:
        self.request = ord("1")
        self.period_s = 0.001
        self.due_s = float("inf")  # of the continuous mode
        self.unlocked = 0  # bytes of the key so far
        self.setting = b""
        self.heard_s = float("-inf")


class SimulatedRls(SerialDevice):
    """The encoders."""

    def __init__(self, table: RlsTable, mounting: DeviceContext) -> None:
        self._table = table
        self._ports: list[_Port] = []
        super().__init__(table, mounting, table.ports)

    def power_up(self, now_s: float) -> None:
        self._ports = [_Port() for _ in self._table.ports]

    @property
    def streaming(self) -> bool:
        return self.own_due_s() != float("inf")

    def own_due_s(self) -> float:
        return min(port.due_s for port in self._ports)

    def advance(self, to_s: float) -> None:
        while (at_s := self.own_due_s()) <= to_s:
            number = [port.due_s for port in self._ports].index(at_s)
            port = self._ports[number]
            port.due_s = at_s + port.period_s
            if self.mounting.struck("reset", at_s, number):
                self._ports[number] = _Port()
            else:
                self._answer(number, port.request, at_s)

    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        """Answer a request, or echo and take a byte of a setting."""
        port = self._ports[line]
        apart_s, port.heard_s = at_s - port.heard_s, at_s
        if port.unlocked and apart_s < BETWEEN_S - 1e-9:
            port.unlocked, port.setting = 0, b""
            self.n_rejected += 1
        if port.unlocked == len(UNLOCK):
            port.setting += bytes((byte,))
            self.say(line, bytes((byte,)), at_s, line)
            self._set(port, at_s)
        elif byte == UNLOCK[port.unlocked]:
            port.unlocked += 1
            self.say(line, bytes((byte,)), at_s, line)
        elif port.due_s == float("inf"):
            port.unlocked = 0
            self._answer(line, byte, at_s)

    def _set(self, port: _Port, at_s: float) -> None:
        n_arguments = ARGUMENTS.get(port.setting[0])
        if n_arguments is None:
            self.n_rejected += 1
        elif len(port.setting) < 1 + n_arguments:
            return
        elif port.setting[0] == ord("T"):
            port.request = port.setting[2]
            period_s = 1e-6 * int.from_bytes(port.setting[3:], "big")
            port.period_s = period_s * (1.0 - 1e-6 * self._table.clock_error_ppm)
        else:
            runs = port.setting[0] == ord("S")
            port.due_s = at_s + port.period_s if runs else float("inf")
        port.unlocked, port.setting = 0, b""

    def _answer(self, line: int, request: int, at_s: float) -> None:
        head = bytes((request,))
        if head == b"v":
            data = (
                head + f"{self.mounting.seed[0] % 10_000:04d}".encode() + b"%02d" % line
            )
        elif head == b"i":
            data = head + b"\x02"  # calibrated twice, nothing to report
        elif head in {b"1", b"3", b"d", b"t"}:
            data = self._position(line, at_s)
            data = data if head == b"3" else head + data
            data += self._conditions(line, at_s) if head == b"d" else b""
            data += self._temperature(at_s) if head == b"t" else b""
        else:
            self.n_rejected += 1
            return
        self.say(line, data, at_s, line)

    def _position(self, line: int, at_s: float) -> bytes:
        count, flags = self.latch(line, at_s)
        bits = self._table.bits
        size = 16 if bits <= 14 else 24
        word = (count % (1 << bits)) << (size - bits)
        word |= (0 if flags & ERROR else 2) | (0 if flags & WARNING else 1)
        data = word.to_bytes(size // 8, "big")
        if self._table.encoder_turns == 1:
            return data
        turns, half = count >> bits, self._table.encoder_turns // 2
        turns -= self._table.encoder_turns * (turns >= half)
        return turns.to_bytes(2, "big", signed=True) + data

    def _conditions(self, line: int, at_s: float) -> bytes:
        script_s = self.mounting.clock.script_s(at_s)
        bits = 0
        for fault in self.mounting.faults:
            if isinstance(fault, StatusFault) and fault.channel == line:
                bits |= fault.value & 0xFF if fault.lasts(script_s) else 0
        return bytes((bits,))

    def _temperature(self, at_s: float) -> bytes:
        script_s = np.array(self.mounting.clock.script_s(at_s))
        warmer_c = float(self.mounting.climate.change_c(script_s))
        tenths = round(10.0 * (self._table.temperature_c + warmer_c))
        return tenths.to_bytes(2, "big", signed=True)

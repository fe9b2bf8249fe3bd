"""AMT21 encoders on one RS-485 line, each answering to its own address.

Written from the makers' protocol: one request byte, address + 0 for the position and
address + 1 for the turns of multi-turn models, answered by 16 bits, low byte first:
14 bits of value below two check bits, the odd and the even parity. Address + 2 and 5E
sets the zero of a single-turn model, and 75 resets; neither is answered.
"""

from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.serial_device import SerialDevice, checked_addresses
from traverse.simulator.devices.serial_table import SerialTable

POSITION, TURNS, EXTENDED = 0, 1, 2
SET_ZERO, RESET = 0x5E, 0x75
VALUE_BITS = 14
MULTI_TURN = 1 << VALUE_BITS


class Amt21Table(SerialTable):
    """Encoders on an RS-485 line; `encoder_turns` is 1, or 16384 for multi-turn."""

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS - {"status"} | {"check"}
    MOST_CHANNELS: ClassVar[int] = 63

    port: str = Field(min_length=1)
    addresses: tuple[int, ...] = Field(min_length=1, max_length=63)
    bits: Literal[12, 14] = 14
    start_up_s: float = Field(default=0.2, ge=0.0, le=10.0)

    @field_validator("addresses")
    @classmethod
    def _check_addresses(cls, addresses: tuple[int, ...]) -> tuple[int, ...]:
        valid = range(4, 253, 4)
        return checked_addresses(addresses, valid, "multiples of 4 from 4 to 252")

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders on this line."""
        yield from self.number_problems("addresses", len(counts_per_turn))
        yield from self.bit_problems(self.bits, MULTI_TURN, counts_per_turn)


class SimulatedAmt21Line(SerialDevice):
    """The encoders of a line."""

    def __init__(self, table: Amt21Table, mounting: DeviceContext) -> None:
        self._channels = {a: number for number, a in enumerate(table.addresses)}
        self._bits = table.bits
        self._multi_turn = table.encoder_turns == MULTI_TURN
        self._start_up_s = table.start_up_s
        self._zeros = [0] * len(table.addresses)  # kept without power
        super().__init__(table, mounting, [table.port])

    def power_up(self, now_s: float) -> None:
        self._ready_s = [now_s] * len(self._zeros)
        self._commanded: int | None = None

    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        """Answer a position or turns request; carry out a command."""
        commanded, self._commanded = self._commanded, None
        if commanded is not None:
            self._carry_out(commanded, byte, at_s)
            return
        channel = self._channels.get(byte & 0xFC)
        if channel is None or at_s < self._ready_s[channel]:
            self.n_rejected += channel is None
            return
        kind = byte & 3
        if kind == POSITION:
            count = self._count(channel, at_s)
            value = count % (1 << self._bits) << (VALUE_BITS - self._bits)
            self._answer(line, channel, value, at_s)
        elif kind == TURNS and self._multi_turn:
            value = self._count(channel, at_s) >> self._bits
            self._answer(line, channel, value % MULTI_TURN, at_s)
        elif kind == EXTENDED:
            self._commanded = channel

    def _carry_out(self, channel: int, command: int, at_s: float) -> None:
        if command == SET_ZERO and not self._multi_turn:
            self._zeros[channel] += self._count(channel, at_s)
        elif command != RESET:
            self.n_rejected += 1
            return
        self._ready_s[channel] = at_s + self._start_up_s

    def _count(self, channel: int, at_s: float) -> int:
        count, _ = self.latch(channel, at_s)
        return count - self._zeros[channel]

    def _answer(self, line: int, channel: int, value: int, at_s: float) -> None:
        script_s = self.mounting.clock.script_s(at_s)
        word = value | _check_bits(value) << VALUE_BITS
        if self.disturbed.spoils_check(script_s, channel):
            word ^= 1 << VALUE_BITS
        self.say(line, word.to_bytes(2, "little"), at_s, channel)


def _check_bits(value: int) -> int:
    """Return K1 K0, which make the number of ones among their bits odd."""
    odd = sum(value >> bit & 1 for bit in range(1, VALUE_BITS, 2))
    even = sum(value >> bit & 1 for bit in range(0, VALUE_BITS, 2))
    return (odd + 1) % 2 << 1 | (even + 1) % 2

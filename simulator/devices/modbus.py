"""Modbus RTU encoders on one RS-485 line, each with its own address.

Written from the specification: address, function, data, and a check sum of 16 bits, low
byte first (polynomial A001, reflected, begun with FFFF). A frame ends where its
function says; 3.5 characters of silence begin a new one. Registers are big-endian. A
refusal is the function with its highest bit set and a code.

An encoder shows its position from `position_register` on, among holding and input
registers, and bits in `status_register`: 0 error, 1 warning. Writing the position's
registers presets the position; other registers store the value.
"""

from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.devices.serial_device import SerialDevice, checked_addresses
from traverse.simulator.devices.serial_table import SerialTable

READ_HOLDING, READ_INPUT, WRITE_ONE, WRITE_MANY = 3, 4, 6, 16
NO_FUNCTION, NO_REGISTER, NO_VALUE = 1, 2, 3
MOST_REGISTERS = 125
BITS = {"none": 10, "even": 11, "odd": 11}
FAST_SILENCE_S = 0.00175  # between frames above 19200 bit/s


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)  # noqa: PLW2901 - a register
        table.append(byte)
    return tuple(table)


CRC_TABLE = _crc_table()


def crc(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ CRC_TABLE[(value ^ byte) & 0xFF]
    return value.to_bytes(2, "little")


class ModbusTable(SerialTable):
    """Encoders on an RS-485 line.

    Attributes:
        addresses: channel i has address i.
        position_register: the first of the position.
        words: registers of the position.
        word_order: "high" word first or "low".
        status_register: of the status bits.
        parity: adds to the duration of a byte; a pty has none.
    """

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS | {"check"}

    port: str = Field(min_length=1)
    addresses: tuple[int, ...] = Field(min_length=1, max_length=32)
    position_register: int = Field(default=0, ge=0, le=65_000)
    words: Literal[1, 2] = 2
    word_order: Literal["high", "low"] = "high"
    status_register: int = Field(default=8, ge=0, le=65_000)
    parity: Literal["none", "even", "odd"] = "even"

    @field_validator("addresses")
    @classmethod
    def _check_addresses(cls, addresses: tuple[int, ...]) -> tuple[int, ...]:
        return checked_addresses(addresses, range(1, 248), "1 to 247")

    def channel_problems(
        self, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report mismatches with the arm file's encoders on this line."""
        yield from self.number_problems("addresses", len(counts_per_turn))
        most = 1 << 16 * self.words
        for channel, counts in enumerate(counts_per_turn):
            if counts * self.encoder_turns > most:
                text = f"{counts * self.encoder_turns} counts of channel {channel}"
                yield "words", f"{text} need more than {self.words} registers"


class SimulatedModbusLine(SerialDevice):
    """The encoders of a line."""

    def __init__(self, table: ModbusTable, mounting: DeviceContext) -> None:
        self._table = table
        self._channels = {a: number for number, a in enumerate(table.addresses)}
        bits = BITS[table.parity]
        byte_s = bits / table.baud_rate if table.baud_rate else 0.0
        self._silence_s = 3.5 * byte_s
        if table.baud_rate == 0 or table.baud_rate > 19_200:
            self._silence_s = FAST_SILENCE_S
        self._zeros = [0] * len(table.addresses)  # kept without power
        self._written: dict[tuple[int, int], int] = {}
        super().__init__(table, mounting, [table.port], bits_per_byte=bits)

    def power_up(self, now_s: float) -> None:
        self._frame = b""
        self._heard_s = now_s

    def receive_byte(self, line: int, byte: int, at_s: float) -> None:
        """Gather a frame; process it once it is whole."""
        if at_s - self._heard_s > self._silence_s:
            self._frame = b""
        self._heard_s = at_s
        self._frame += bytes((byte,))
        if len(self._frame) < self._size():
            return
        frame, self._frame = self._frame, b""
        channel = self._channels.get(frame[0])
        if crc(frame[:-2]) != frame[-2:]:
            self.n_rejected += 1
        elif channel is not None:
            answer = frame[:1] + self._obey(channel, frame[1:-2], at_s)
            self._send(line, channel, answer, at_s)

    def _size(self) -> int:
        """Return the length of the frame in bytes, as far as known."""
        if self._frame[1:2] == bytes((WRITE_MANY,)):
            return 9 + self._frame[6] if len(self._frame) > 6 else 9
        return 8

    def _obey(self, channel: int, request: bytes, at_s: float) -> bytes:
        function = request[0]
        first, value = (int.from_bytes(request[i : i + 2], "big") for i in (1, 3))
        if function in {READ_HOLDING, READ_INPUT}:
            return self._read(channel, function, first, value, at_s)
        if function == WRITE_ONE:
            self._write(channel, first, [value], at_s)
            return request
        data = request[6:]
        if function == WRITE_MANY and len(data) == 2 * value:
            words = [int.from_bytes(data[i : i + 2]) for i in range(0, len(data), 2)]
            self._write(channel, first, words, at_s)
            return request[:5]
        known = function == WRITE_MANY
        return bytes((function | 0x80, NO_VALUE if known else NO_FUNCTION))

    def _read(
        self, channel: int, function: int, first: int, n_registers: int, at_s: float
    ) -> bytes:
        if not 1 <= n_registers <= MOST_REGISTERS:
            return bytes((function | 0x80, NO_VALUE))
        known = self._registers(channel, at_s)
        numbers = range(first, first + n_registers)
        if not known.keys() >= set(numbers):
            return bytes((function | 0x80, NO_REGISTER))
        data = b"".join(known[number].to_bytes(2, "big") for number in numbers)
        return bytes((function, len(data))) + data

    def _registers(self, channel: int, at_s: float) -> dict[int, int]:
        table = self._table
        count, flags = self.latch(channel, at_s)
        modulus = int(self.mounting.encoders.moduli[channel])
        position = (count - self._zeros[channel]) % modulus
        words = [position >> 16, position & 0xFFFF][-table.words :]
        if table.word_order == "low":
            words.reverse()
        written = {n: w for (c, n), w in self._written.items() if c == channel}
        shown = {table.position_register + i: word for i, word in enumerate(words)}
        return written | {table.status_register: flags & 3} | shown

    def _write(self, channel: int, first: int, words: list[int], at_s: float) -> None:
        table = self._table
        if first == table.position_register and len(words) == table.words:
            ordered = words if table.word_order == "high" else words[::-1]
            preset = int.from_bytes(b"".join(w.to_bytes(2, "big") for w in ordered))
            count, _ = self.latch(channel, at_s)
            self._zeros[channel] = count - preset
            return
        for number, word in enumerate(words, start=first):
            self._written[channel, number] = word

    def _send(self, line: int, channel: int, answer: bytes, at_s: float) -> None:
        script_s = self.mounting.clock.script_s(at_s)
        check = crc(answer)
        if self.disturbed.spoils_check(script_s, channel):
            check = bytes((check[0] ^ 0x10, check[1]))
        self.say(line, answer + check, at_s, channel)

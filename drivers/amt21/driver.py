"""Driver of Same Sky (CUI) AMT21 encoders on one RS-485 line.

Each encoder is asked in turn; a reading belongs to the middle of its exchange. What an
encoder does between request and reply is not known better than that: that it latches
when the request arrives is general knowledge, and not confirmed, as is that the turns
of a multi-turn encoder change where its position passes 0.
"""

import time
from collections.abc import Callable, Sequence
from typing import Literal

from pydantic import Field, field_validator

from traverse.drivers.amt21.line import Amt21Line, TimedValue
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.options import DriverOptions
from traverse.drivers.io.byte_port import BytePort, OpenPort
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.polled_driver import (
    PolledDriver,
    WaitForWake,
    wait_for_wake,
)
from traverse.protocol import amt21

TURNS_CHECK_NS = 1_000_000_000  # in between, whole turns are counted by the host

WRONG_BITS = ReadError(
    "wrong_bits",
    "answers with more than 12 bits",
    "set bits = 14, and counts_per_turn = 16384 in the arm file",
)
TURNS_UNSTEADY = ReadError(
    "turns_unsteady",
    "counts turns that do not fit its position",
    "set turns = false if it is a single-turn model; check the cable",
)


class Amt21Options(DriverOptions):
    """What the table of a line with AMT21 encoders may say."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=2_000_000, ge=9600, le=2_000_000)
    addresses: tuple[int, ...] = Field(min_length=1, max_length=32)
    bits: Literal[12, 14] = 14
    turns: bool = False
    echo: Literal["auto", "yes", "no"] = "auto"
    answer_timeout_s: float = Field(default=0.005, ge=0.001, le=1.0)
    max_rate_hz: float = Field(default=2000.0, ge=1.0, le=5000.0)
    max_speed_rad_s: float = Field(default=20.0, ge=1.0, le=1000.0)

    @field_validator("addresses")
    @classmethod
    def _check_addresses(cls, addresses: tuple[int, ...]) -> tuple[int, ...]:
        for address in addresses:
            if not amt21.is_address(address):
                raise ValueError(
                    f"{address:#04x} is no address of an AMT21; expected multiples "
                    "of 4, from 0x04 to 0xFC"
                )
            if addresses.count(address) > 1:
                raise ValueError(f"{address:#04x} is given twice")
        return addresses


class Amt21Driver(PolledDriver):
    """Encoders on one line; channel i is the one with address i of ``addresses``.

    Args:
        device: id in the configuration.
        delivery_queue: where deliveries go.
        port: path of the serial port.
        addresses: of the encoders.
        baud_rate: of the line.
        bits: resolution of the encoders, 12 or 14.
        turns: they count whole turns, which are to be read too.
        echo: whether the adapter gives back what is sent.
        answer_timeout_s: within which a reply comes through the adapter.
        max_rate_hz: no faster stream is offered.
        max_speed_rad_s: no joint turns faster.
        monotonic_ns: the host's clock.
        wait_for: waits for the next instant.
        open_port: opens the line.
    """

    options = Amt21Options

    def __init__(
        self,
        device: str,
        delivery_queue: DeliveryQueue,
        *,
        port: str,
        addresses: Sequence[int],
        baud_rate: int = 2_000_000,
        bits: Literal[12, 14] = 14,
        turns: bool = False,
        echo: Literal["auto", "yes", "no"] = "auto",
        answer_timeout_s: float = 0.005,
        max_rate_hz: float = 2000.0,
        max_speed_rad_s: float = 20.0,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        wait_for: WaitForWake = wait_for_wake,
        open_port: OpenPort = SerialPort,
    ) -> None:
        super().__init__(
            device,
            delivery_queue,
            max_rate_hz=max_rate_hz,
            monotonic_ns=monotonic_ns,
            wait_for=wait_for,
        )
        self._path = port
        self._addresses = tuple(addresses)
        self._baud_rate = baud_rate
        self._bits = bits
        self._turns = turns
        self._echo = echo
        self._timeout_s = answer_timeout_s
        self._max_speed_rad_s = max_speed_rad_s
        self._open_port = open_port
        self._port: BytePort | None = None
        self._line: Amt21Line | None = None
        self._turns_checked_ns = [0] * len(addresses)
        self._unrequested_before = 0

    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        self._port = self._open_port(self._path, self._baud_rate, self._wake_read)
        self._line = Amt21Line(
            self._port, self._now_ns, self._timeout_s, echoed=self._echo == "yes"
        )
        if self._echo == "auto":
            self._line.find_echo(self._addresses)
        modulus = 1 << self._bits
        if self._turns:
            modulus <<= amt21.VALUE_BITS
        name = f"{len(self._addresses)} AMT21 encoders on {self._path}"
        return name, [
            PolledChannel(
                f"encoder {address:#04x}",
                modulus,
                1 << self._bits,
                self._max_speed_rad_s,
            )
            for address in self._addresses
        ]

    def _disconnect(self) -> None:
        if self._line is not None:
            self._unrequested_before += self._line.unrequested_bytes
            self._line = None
        if self._port is not None:
            self._port.close()
            self._port = None

    def _cycle_is_valid(self) -> bool:
        line = self._open_line()
        sound = line.take_validity()
        self._counters["stray_bytes"] = (
            self._unrequested_before + line.unrequested_bytes
        )
        self._counters["exchange_us"] = round(line.exchange_ns * 1e-3)
        self._counters["longest_exchange_us"] = round(line.longest_ns * 1e-3)
        self._counters["echoed"] = int(line.echoed)
        return sound

    def _read_channel(self, channel: int) -> EncoderReading | ReadError:
        if not self._turns:
            return self._position(channel)
        known = self._channels[channel]
        if known.time_ns is None or self._turns_are_due(channel, known.time_ns):
            return self._position_and_turns(channel)
        reading = self._position(channel)
        if isinstance(reading, ReadError):
            return reading
        return EncoderReading(self._nearest(known, reading.count), reading.time_ns)

    def _position(self, channel: int) -> EncoderReading | ReadError:
        answer = self._ask(channel, amt21.position_request(self._addresses[channel]))
        if isinstance(answer, ReadError):
            return answer
        unused = amt21.VALUE_BITS - self._bits
        if answer.value & ((1 << unused) - 1):
            return WRONG_BITS
        return EncoderReading(answer.value >> unused, answer.time_ns)

    def _position_and_turns(self, channel: int) -> EncoderReading | ReadError:
        """A position between two readings of the turns, which tell whether 0 passed."""
        request = amt21.turns_request(self._addresses[channel])
        before = self._ask(channel, request)
        if isinstance(before, ReadError):
            return before
        position = self._position(channel)
        if isinstance(position, ReadError):
            return position
        after = self._ask(channel, request)
        if isinstance(after, ReadError):
            return after
        first, second = amt21.turns_of(before.value), amt21.turns_of(after.value)
        if abs(first - second) > 1:
            return TURNS_UNSTEADY
        upper_half = position.count >> (self._bits - 1)
        turns = min(first, second) if upper_half else max(first, second)
        known = self._channels[channel]
        count = ((turns << self._bits) + position.count) % known.modulus
        self._turns_checked_ns[channel] = position.time_ns
        if known.time_ns is not None and count != self._nearest(known, position.count):
            self._fault(
                "turns_corrected",
                f"{known.name} says {turns} whole turns, which is not what was counted",
                "check a known point before measuring on",
            )
            known.reset()
        return EncoderReading(count, position.time_ns)

    def _turns_are_due(self, channel: int, last_ns: int) -> bool:
        """Long ago, or the shaft may have made half a turn unseen."""
        now_ns = self._now_ns()
        half_turn_ns = 3.14 / self._max_speed_rad_s * 1e9
        checked_ns = self._turns_checked_ns[channel]
        return now_ns - checked_ns > TURNS_CHECK_NS or now_ns - last_ns > half_turn_ns

    def _nearest(self, known: PolledChannel, position: int) -> int:
        """The count with this position that is nearest to the last one."""
        turn = 1 << self._bits
        step = (position - known.count + turn // 2) % turn - turn // 2
        return (known.count + step) % known.modulus

    def _ask(self, channel: int, request: bytes) -> TimedValue | ReadError:
        patient = not self._channels[channel].missing
        return self._open_line().ask(request, patient=patient)

    def _open_line(self) -> Amt21Line:
        if self._line is None:
            raise RuntimeError(f"the line of {self.device} is not open")
        return self._line

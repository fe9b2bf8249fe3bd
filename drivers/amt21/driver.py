"""Driver of Same Sky (CUI) AMT21 encoders on one RS-485 line.

Each encoder is polled in turn; a reading belongs to the middle of its exchange. That an
encoder latches when the request arrives, and that the turns of a multi-turn encoder
change where its position passes 0, is general knowledge and not confirmed.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from pydantic import Field, field_validator

from traverse.drivers.amt21.line import Amt21Line
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.polled_driver import PolledDriver, PolledOptions
from traverse.plurals import counted
from traverse.protocol import amt21


class Amt21Options(PolledOptions):
    """Options of the driver `amt21`; channel i is the encoder ``addresses[i]``."""

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=2_000_000, ge=9600, le=2_000_000)
    addresses: tuple[int, ...] = Field(min_length=1, max_length=32)
    bits: Literal[12, 14] = 14
    turns: bool = False
    echo: Literal["auto", "yes", "no"] = "auto"
    answer_timeout_s: float = Field(default=0.005, ge=0.001, le=1.0)
    max_rate_hz: float = Field(default=2000.0, ge=1.0, le=5000.0)

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


SHORT_MODEL_BITS = 12
SHOWS_MODEL = 20  # readings that change: of 14 bits one in four has 0 in the low two
TURNS_CHECK_NS = 1_000_000_000  # in between, whole turns are counted by the host

WRONG_BITS = ReadError(
    "wrong_bits",
    "answers with more than 12 bits",
    "set bits = 14, and counts_per_turn = 16384 in the arm file",
    is_damage=True,
)
TURNS_UNSTEADY = ReadError(
    "turns_unsteady",
    "counts turns that do not fit its position",
    "set turns = false if it is a single-turn model; check the cable",
)


class Amt21Driver(PolledDriver[Amt21Line]):
    """Encoders on one line; channel i is the one with address i of ``addresses``."""

    options: Amt21Options
    options_class = Amt21Options

    def _prepare(self) -> None:
        self._addresses = self.options.addresses
        self._bits = self.options.bits
        self._turns = self.options.turns
        self._turns_checked_ns = [0] * len(self._addresses)
        self._multiples_of_4: dict[int, set[int]] = {}  # by channel; until another
        if self._bits == amt21.VALUE_BITS:
            self._multiples_of_4 = {n: set() for n in range(len(self._addresses))}

    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        options = self.options
        self._line = Amt21Line(
            self._ports.open(options.port, options.baud_rate, self._wake_read),
            self._now_ns,
            options.answer_timeout_s,
            echoed=options.echo == "yes",
        )
        if options.echo == "auto":
            self._line.find_echo(self._addresses)
        modulus = 1 << self._bits
        if self._turns:
            modulus <<= amt21.VALUE_BITS
        name = f"{len(self._addresses)} AMT21 encoders on {options.port}"
        return name, [
            PolledChannel(
                f"encoder {address:#04x}",
                modulus,
                1 << self._bits,
                options.max_speed_rad_s,
                is_checked=False,  # two check bits pass one bad word in four
            )
            for address in self._addresses
        ]

    def _cycle_is_valid(self) -> bool:
        line = self._open_line
        sound = line.take_validity()
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
        return replace(reading, count=self._nearest(known, reading.count))

    def _position(self, channel: int) -> EncoderReading | ReadError:
        answer = self._get(channel, amt21.position_request(self._addresses[channel]))
        if isinstance(answer, ReadError):
            return answer
        unused = amt21.VALUE_BITS - self._bits
        if answer.count & ((1 << unused) - 1):
            return WRONG_BITS
        if channel in self._multiples_of_4:
            self._look_for_short_model(channel, answer.count)
        return replace(answer, count=answer.count >> unused)

    def _look_for_short_model(self, channel: int, value: int) -> None:
        """Report a model of 12 bits, whose steps of 4 look like spoilt readings."""
        seen = self._multiples_of_4[channel]
        if value % 4 == 0:
            seen.add(value)
        if value % 4 or len(seen) == SHOWS_MODEL:
            del self._multiples_of_4[channel]
            if value % 4 == 0:
                self._fault(
                    "fewer_bits",
                    f"encoder {self._addresses[channel]:#04x} sends multiples of 4 "
                    f"only: it is a model of {SHORT_MODEL_BITS} bits, whose steps are "
                    "taken for spoilt readings",
                    f"set bits = {SHORT_MODEL_BITS}, and counts_per_turn = 4096 in the "
                    "arm file",
                )

    def _position_and_turns(self, channel: int) -> EncoderReading | ReadError:
        request = amt21.turns_request(self._addresses[channel])
        before = self._get(channel, request)
        if isinstance(before, ReadError):
            return before
        position = self._position(channel)
        if isinstance(position, ReadError):
            return position
        after = self._get(channel, request)
        if isinstance(after, ReadError):
            return after
        first, second = amt21.turns_of(before.count), amt21.turns_of(after.count)
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
                f"{known.name} reports {counted(turns, 'whole turn')}, unlike the "
                "count",
                "check a known point before measuring on",
            )
            known.reset()
        return replace(position, count=count)

    def _turns_are_due(self, channel: int, last_ns: int) -> bool:
        """Return whether the shaft may have made half a turn since the last reading."""
        now_ns = self._now_ns()
        half_turn_ns = 3.14 / self.options.max_speed_rad_s * 1e9
        checked_ns = self._turns_checked_ns[channel]
        return now_ns - checked_ns > TURNS_CHECK_NS or now_ns - last_ns > half_turn_ns

    def _nearest(self, known: PolledChannel, position: int) -> int:
        turn = 1 << self._bits
        step = (position - known.count + turn // 2) % turn - turn // 2
        return (known.count + step) % known.modulus

    def _get(self, channel: int, request: bytes) -> EncoderReading | ReadError:
        patient = not self._channels[channel].missing
        return self._open_line.ask(request, patient=patient)

"""Driver of Modbus RTU encoders, several on one line, through pymodbus.

Each is polled in turn; a reading belongs to the middle of the time between request and
reply (`traverse.drivers.polling.exchange`). That an encoder
latches when the request has arrived is general knowledge and differs by maker; many
renew their position only every few milliseconds. The configuration sets the meaning of
registers: there is no standard.
"""

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, field_validator, model_validator
from pymodbus.exceptions import ModbusException

from traverse.drivers.base.values import STATUS_ERROR, STATUS_WARNING
from traverse.drivers.modbus.line import ModbusClient
from traverse.drivers.polling.alarms import ConditionAlarms
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.exchange import ExchangeTimer
from traverse.drivers.polling.polled_driver import PolledDriver, PolledOptions
from traverse.plurals import counted
from traverse.protocol.modbus import MOST_COUNTS, PositionRegisters
from traverse.strict_toml.reader import StrictModel

FIXED_SILENCE_ABOVE_BAUD = 19_200
FAST_SILENCE_S = 0.00175  # between two frames above that
SILENCE_CHARACTERS = 3.5
REQUEST_BYTES, REPLY_BYTES = 8, 5  # of registers; and two for each of them
BITS_OF_BYTE = {"none": 10, "even": 11, "odd": 11}
CONDITIONS = {
    "encoder_error": (
        "its position is not valid",
        "see the encoder's manual for its status register",
    ),
    "encoder_warning": ("it warns", "see the encoder's manual for its status register"),
}


class ModbusEncoder(StrictModel):
    """One encoder: its address and registers.

    Registers are counted from 0: what a manual calls register 1, or 30001, is 0.
    """

    address: int = Field(ge=1, le=247)
    counts_per_turn: int = Field(ge=2, le=2**32)
    turns: int = Field(default=1, ge=1, le=2**31)
    function: Literal[3, 4] = 4
    position_register: int = Field(default=0, ge=0, le=65_535)
    words: Literal[1, 2, 4] = 2
    word_order: Literal["high", "low"] = "high"
    signed: bool = False
    scale: float = Field(default=1.0, gt=0.0, le=1e9)
    status_register: int | None = Field(default=None, ge=0, le=65_535)
    status_function: Literal[3, 4] = 4
    error_mask: int = Field(default=0, ge=0, le=0xFFFF)
    warning_mask: int = Field(default=0, ge=0, le=0xFFFF)

    @property
    def modulus(self) -> int:
        return self.counts_per_turn * self.turns

    @property
    def registers(self) -> PositionRegisters:
        return PositionRegisters(
            self.position_register,
            self.words,
            self.word_order,
            self.signed,
            self.scale,
            self.modulus,
        )

    @model_validator(mode="after")
    def _check_range(self) -> "ModbusEncoder":
        if self.modulus > MOST_COUNTS:
            raise ValueError(
                f"{self.counts_per_turn} counts per turn in "
                f"{counted(self.turns, 'turn', 'are')} "
                "more than 2^32 counts; lower turns, they are taken modulo"
            )
        if self.status_register is None and (self.error_mask or self.warning_mask):
            raise ValueError("masks without a status_register; add it")
        return self


class ModbusOptions(PolledOptions):
    """Options of the driver `modbus`; channel i is the encoder ``encoders[i]``.

    A status period of 0 reads no status register.
    """

    port: str = Field(min_length=1)
    encoders: tuple[ModbusEncoder, ...] = Field(min_length=1, max_length=32)
    baud_rate: int = Field(default=19_200, ge=1200, le=1_000_000)
    parity: Literal["none", "even", "odd"] = "even"
    stop_bits: Literal[1, 2] = 1
    echo: bool = False
    status_period_s: float = Field(default=1.0, ge=0.0, le=3600.0)
    answer_timeout_s: float = Field(default=0.1, ge=0.005, le=5.0)
    max_rate_hz: float = Field(default=500.0, ge=1.0, le=2000.0)

    @field_validator("encoders")
    @classmethod
    def _check_addresses(
        cls, encoders: tuple[ModbusEncoder, ...]
    ) -> tuple[ModbusEncoder, ...]:
        addresses = [encoder.address for encoder in encoders]
        for address in addresses:
            if addresses.count(address) > 1:
                raise ValueError(f"address {address} is given twice")
        return encoders

    @property
    def silence_s(self) -> float:
        if self.baud_rate > FIXED_SILENCE_ABOVE_BAUD:
            return FAST_SILENCE_S
        return SILENCE_CHARACTERS * BITS_OF_BYTE[self.parity] / self.baud_rate


DOUBTED_TIMEOUTS = 8  # a reply that arrives later than that is not to our request
LATE_S = 0.002  # more than the usual exchange that a late reply is waited for
SILENT = ReadError(
    "silent",
    "does not answer",
    "check power, wires A and B, its address, baud rate and parity",
)
REFUSED = ReadError(
    "refused",
    "refuses to send its registers",
    "check function, position_register and words with the encoder's manual",
)
ECHOED = ReadError(
    "echoed",
    "cannot be heard behind our own requests",
    "the adapter echoes what is sent: set echo = true",
)
BUSY = ReadError(
    "busy",
    "answers that it is busy",
    "lower tracking_rate_hz; see the encoder's manual for how often it may be read",
)
BUSY_CODE = 6  # of an exception, Modbus Application Protocol V1.1b3, section 7
SHIFTED = ReadError(
    "shifted", "sends more than requested", "check cable and termination"
)
BEYOND = ReadError(
    "beyond",
    "sends positions beyond counts_per_turn times turns",
    "set turns if it counts several; else check position_register, words, word_order, "
    "scale and counts_per_turn with the encoder's manual",
)


class ModbusDriver(PolledDriver[ModbusClient]):
    """Encoders on one line; channel i is encoder i of ``encoders``."""

    options: ModbusOptions
    options_class = ModbusOptions

    def _prepare(self) -> None:
        options = self.options
        self._encoders = options.encoders
        self._registers = [encoder.registers for encoder in self._encoders]
        self._timeout_s = options.answer_timeout_s
        self._doubted_until_ns = [0] * len(self._encoders)
        self._longest_ns = 0
        self._asks_status = [
            n for n, e in enumerate(self._encoders) if e.status_register is not None
        ]
        n_asked = max(1, len(self._asks_status))
        self._status_ns = round(options.status_period_s * 1e9 / n_asked)
        self._status_due_ns = 0
        self._status_turn = 0
        self._flags = [0] * len(self._encoders)
        self._status = ConditionAlarms(
            self.device, self._delivery_queue.put, CONDITIONS
        )
        self._names = {
            n: f"encoder {encoder.address}" for n, encoder in enumerate(self._encoders)
        }

    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        options = self.options
        port = self._ports.open(
            options.port,
            options.baud_rate,
            self._wake_read,
            parity=options.parity[0].upper(),
            stop_bits=options.stop_bits,
        )
        self._line = ModbusClient(
            port,
            self._now_ns,
            self._pass,
            timeout_s=self._timeout_s,
            silence_s=options.silence_s,
            echo=options.echo,
        )
        self._timer = ExchangeTimer(port.byte_ns)
        name = f"{len(self._encoders)} Modbus encoders on {options.port}"
        return name, [
            PolledChannel(
                self._names[n], e.modulus, e.counts_per_turn, options.max_speed_rad_s
            )
            for n, e in enumerate(self._encoders)
        ]

    def _read_channel(self, channel: int) -> EncoderReading | ReadError:
        encoder, registers = self._encoders[channel], self._registers[channel]
        reply = self._get(channel, encoder.function, registers.first, registers.words)
        if isinstance(reply, ReadError):
            return reply
        words, (sent_ns, received_ns) = reply
        if (count := registers.count(words)) is None:
            return BEYOND
        time_ns, bound_ns = self._timer.latch(
            sent_ns, received_ns, REQUEST_BYTES, REPLY_BYTES + 2 * len(words)
        )
        return EncoderReading(count, time_ns, self._flags[channel], bound_ns)

    def _cycle_is_valid(self) -> bool:
        now_ns = self._now_ns()
        if self._asks_status and self._status_ns and now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + self._status_ns
            self._status_turn = (self._status_turn + 1) % len(self._asks_status)
            self._ask_status(self._asks_status[self._status_turn])
        self._counters["longest_exchange_us"] = round(self._longest_ns * 1e-3)
        self._status.report(self._names, now_ns)
        return True

    def _ask_status(self, channel: int) -> None:
        """Read an encoder's status, which marks its following samples."""
        encoder = self._encoders[channel]
        if encoder.status_register is None or self._channels[channel].missing:
            return
        reply = self._get(channel, encoder.status_function, encoder.status_register, 1)
        if isinstance(reply, ReadError):
            self._counters["status_missed"] += 1
            return
        error = bool(reply[0][0] & encoder.error_mask)
        warning = bool(reply[0][0] & encoder.warning_mask)
        self._flags[channel] = STATUS_ERROR * error | STATUS_WARNING * warning
        codes = {"encoder_error": error, "encoder_warning": warning}
        self._status.add(channel, [code for code, is_so in codes.items() if is_so])

    def _get(
        self, channel: int, function: int, first: int, n_words: int
    ) -> tuple[list[int], tuple[int, int]] | ReadError:
        """Return registers of an encoder, with begin and end of the exchange."""
        client = self._open_line
        read = client.read_input_registers
        if function == 3:
            read = client.read_holding_registers
        doubtful = self._now_ns() < self._doubted_until_ns[channel]
        missing = bool(self._channels) and self._channels[channel].missing
        client.timeout_s = self._usual_s() if missing else self._timeout_s
        miss: ReadError | None = None
        words: list[int] = []
        try:
            reply = read(
                first, count=n_words, device_id=self._encoders[channel].address
            )
        except ModbusException:
            miss = ECHOED if client.is_echoed else SILENT
        else:
            words = list(reply.registers)
            if reply.isError() or len(words) != n_words:
                miss = BUSY if reply.exception_code == BUSY_CODE else REFUSED
        sent_ns, received_ns = client.sent_ns, client.received_ns
        if miss in {SILENT, ECHOED} or doubtful:
            # A late reply must not pass for that to the next question.
            late = client.discard_late_bytes(self._usual_s())
            miss = miss or (SHIFTED if late else None)
        if miss is not None:
            doubt_ns = round(DOUBTED_TIMEOUTS * self._timeout_s * 1e9)
            may_come_late = miss not in {REFUSED, BUSY}
            self._doubted_until_ns[channel] = sent_ns + doubt_ns * may_come_late
            return miss
        self._longest_ns = max(self._longest_ns, received_ns - sent_ns)
        return words, (sent_ns, received_ns)

    def _usual_s(self) -> float:
        """Return a time within which most replies arrive; at first the time-out."""
        usual_s = self._longest_ns * 1e-9 + LATE_S
        return min(self._timeout_s, usual_s) if self._longest_ns else self._timeout_s

    def _pass(self, seconds: float) -> None:
        """Wait for a time, ignoring wake-ups."""
        until_ns = self._now_ns() + round(seconds * 1e9)
        while (left_ns := until_ns - self._now_ns()) > 0:
            self._ports.wait_for_any((), self._wake_read, left_ns * 1e-9)

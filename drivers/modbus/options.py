"""Options of the table of a line with Modbus encoders."""

from typing import Literal

from pydantic import Field, field_validator, model_validator

from traverse.drivers.polling.polled_driver import PolledOptions
from traverse.plurals import counted
from traverse.protocol.modbus import PositionRegisters
from traverse.strict_toml.reader import StrictModel

FIXED_SILENCE_ABOVE_BAUD = 19_200
FAST_SILENCE_S = 0.00175  # between two frames above that
SILENCE_CHARACTERS = 3.5
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
        """Count at which it wraps to 0."""
        return self.counts_per_turn * self.turns

    @property
    def registers(self) -> PositionRegisters:
        """Those with its position."""
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
        if self.modulus > 2**32:
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
        """Between two frames."""
        if self.baud_rate > FIXED_SILENCE_ABOVE_BAUD:
            return FAST_SILENCE_S
        return SILENCE_CHARACTERS * BITS_OF_BYTE[self.parity] / self.baud_rate

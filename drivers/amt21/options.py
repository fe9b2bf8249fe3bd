"""Options of the table of a line with AMT21 encoders."""

from typing import Literal

from pydantic import Field, field_validator

from traverse.drivers.polling.polled_driver import PolledOptions
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

"""Options of the table of RLS encoders, and their alarms."""

from typing import Literal

from pydantic import Field, field_validator

from traverse.drivers.polling.polled_driver import PolledOptions
from traverse.protocol import rls

CONDITIONS = {
    "encoder_error": (
        "its position is not valid",
        "see its other alarms; check its mounting",
    ),
    "encoder_warning": (
        "its position is barely valid",
        "see its other alarms; check its mounting",
    ),
    "signal_too_high": ("the magnet is too near", "increase the ride height"),
    "signal_too_low": ("the magnet is too far", "reduce the ride height"),
    "temperature_out_of_range": (
        "its temperature is out of range",
        "let it cool down or warm up",
    ),
    "speed_too_high": ("it turns too fast", "move the arm more slowly"),
    "turns_counter_error": (
        "its counter of turns is wrong",
        "switch it off and on near its zero",
    ),
}


class RlsOptions(PolledOptions):
    """Options of the driver `rls`; channel i is the encoder on ``ports[i]``.

    In the mode "continuous" the encoders answer by themselves, every ``period_us``.
    ``detailed`` reads an encoder's complaints; 0 as period reads no
    temperature.
    """

    ports: tuple[str, ...] = Field(min_length=1, max_length=16)
    baud_rate: int = Field(default=115_200, ge=9600, le=6_000_000)
    bits: int = Field(default=14, ge=rls.LEAST_BITS, le=rls.MOST_BITS)
    turns: bool = False
    mode: Literal["asked", "continuous"] = "asked"
    period_us: int = Field(default=1000, ge=250, le=65_535)
    detailed: bool = True
    temperature_period_s: float = Field(default=10.0, ge=0.0, le=3600.0)
    answer_timeout_s: float = Field(default=0.01, ge=0.001, le=1.0)
    max_rate_hz: float = Field(default=2000.0, ge=1.0, le=4000.0)

    @field_validator("ports")
    @classmethod
    def _check_ports(cls, ports: tuple[str, ...]) -> tuple[str, ...]:
        for port in ports:
            if ports.count(port) > 1:
                raise ValueError(f"{port} is given twice; each encoder has its own")
        return ports

    @property
    def layout(self) -> rls.Layout:
        return rls.Layout(self.bits, self.turns)

    @property
    def where(self) -> str:
        return ", ".join(self.ports)

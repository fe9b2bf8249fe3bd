"""The `[quality]` table: limits beyond which measurements are marked, or refused."""

from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from traverse.daemon.config.filters import flag_bits
from traverse.kinematics.arm_file.arm import StrictModel


class EndStopSection(StrictModel):
    """How far a joint can turn."""

    joint: str = Field(min_length=1)
    low_rad: float
    high_rad: float
    margin_rad: float = Field(default=0.035, ge=0.0, le=3.2)

    @model_validator(mode="after")
    def _leaves_a_way(self) -> Self:
        if self.high_rad - self.low_rad <= 2.0 * self.margin_rad:
            text = (
                f"low_rad {self.low_rad:g} and high_rad {self.high_rad:g}: nothing is "
                f"left between margins of {self.margin_rad:g}; correct them"
            )
            raise ValueError(text)
        return self


class QualitySection(StrictModel):
    """Limits; those that are left out are not looked at."""

    end_stops: Annotated[tuple[EndStopSection, ...], Field(max_length=64)] = ()
    singular_ratio: float | None = Field(default=None, gt=0.0, lt=1.0)
    overspeed_mm_s: float | None = Field(default=None, gt=0.0)
    temperature_low_c: float | None = Field(default=None, ge=-273.15)
    temperature_high_c: float | None = None
    temperature_change_c: float | None = Field(default=3.0, gt=0.0)
    temperature_time_s: float = Field(default=300.0, ge=1.0, le=86_400.0)
    identification_days: float | None = Field(default=None, gt=0.0)
    refuse: Annotated[tuple[str, ...], Field(max_length=32)] = ()

    @field_validator("refuse")
    @classmethod
    def _are_flags(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        flag_bits(names)
        return names

    @model_validator(mode="after")
    def _is_a_band(self) -> Self:
        low_c, high_c = self.temperature_low_c, self.temperature_high_c
        if low_c is not None and high_c is not None and low_c >= high_c:
            text = f"temperature_low_c {low_c:g} below temperature_high_c {high_c:g}"
            raise ValueError(text)
        return self

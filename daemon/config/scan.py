"""The `[scan]` table: rates, buttons that hold a scan, filters, delivery."""

from typing import Annotated, Literal

from pydantic import Field

from traverse.daemon.config.filters import AnyFilter
from traverse.kinematics.arm_file.arm import StrictModel


class ScanSection(StrictModel):
    """What a scan's command leaves open, and which of its points pass."""

    rate_hz: float = Field(default=100.0, gt=0.0, le=10_000.0)
    dense_rate_hz: float = Field(default=1000.0, ge=10.0, le=10_000.0)
    held_wait_s: float = Field(default=0.2, ge=0.01, le=2.0)
    delivery: Literal["live", "complete"] = "live"
    spool_mb: float = Field(default=1000.0, ge=2.0, le=1_000_000.0)
    spool_days: float = Field(default=7.0, gt=0.0, le=36_500.0)
    filters: Annotated[tuple[AnyFilter, ...], Field(max_length=32)] = ()

"""Options of the `[[device]]` table of a MicroScribe."""

from typing import Literal

from pydantic import Field

from traverse.drivers.base.options import DriverOptions

BaudRate = Literal[9600, 14400, 19200, 28800, 38400, 57600, 115200]


class MicroscribeOptions(DriverOptions):
    """Of a MicroScribe.

    Packets are sent on "request", or by the arm's own "motion"; 0 as timer rate
    leaves its timer unused.
    """

    port: str = Field(min_length=1)
    baud_rate: BaudRate = 115200
    report: Literal["request", "motion"] = "request"
    timer_rate_hz: float = Field(default=1000.0, ge=0.0, le=100_000.0)
    debounce_ms: int = Field(default=20, ge=0, le=1000)
    max_speed_rad_s: float = Field(default=20.0, gt=0.0, le=1000.0)

"""Options of a latch board."""

from pydantic import Field

from traverse.drivers.base.options import DriverOptions


class LatchBoardOptions(DriverOptions):
    """Options of the driver `latch-board`.

    Attributes:
        port: path of the serial port.
        baud_rate: of the line.
        debounce_us: how long an input must hold its new level.
    """

    port: str = Field(min_length=1)
    baud_rate: int = Field(default=1_000_000, ge=9600, le=12_000_000)
    debounce_us: int = Field(default=5000, ge=0, le=1_000_000)

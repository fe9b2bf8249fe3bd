"""Options of the `[[device]]` table of a board that prints lines."""

from functools import cached_property
from typing import Literal

from pydantic import Field, model_validator

from traverse.drivers.base.driver import DriverOptions
from traverse.drivers.text_line.board_time import LEAST_WRAP_S, UNITS_S
from traverse.drivers.text_line.line import LinePattern
from traverse.plurals import counted

COUNTER_TICKS = 1 << 32  # of millis() and micros()
NEVER_TICKS = 1 << 62
TICKS_PER_S = {"s": 1_000_000, "ms": 1000, "us": 1_000_000}


class TextLineOptions(DriverOptions):
    """Options of the driver `text-line`; channel i is the i-th ``{joint}``.

    Attributes:
        port: path of the serial port.
        pattern: a line as the board prints it, with fields in braces.
        counts_per_turn: of each joint; of angles, their resolution.
        baud_rate: of the line; without meaning on a board's own USB.
        unit: of ``{joint}``.
        decimals: digits behind the point of every angle; None: any number.
        time_unit: of ``{time}``.
        time_wrap: after so many units ``{time}`` is 0 again; None: as a counter of 32
            bits, seconds never.
        seq_bits: after so many bits ``{seq}`` is 0 again.
        checksum: what ``{checksum}`` is, two hexadecimal digits.
        ignore: beginnings of lines that are not about joints.
        start_command: a line sent until the board prints.
        debounce_ms: a button's next edge is not looked for earlier.
        max_speed_rad_s: no joint turns faster.
        silence_s: so long without a valid line the board is lost.
    """

    port: str = Field(min_length=1)
    pattern: str = Field(min_length=1, max_length=400)
    counts_per_turn: tuple[int, ...] = Field(min_length=1, max_length=32)
    baud_rate: int = Field(default=115_200, ge=1200, le=12_000_000)
    unit: Literal["counts", "deg", "rad"] = "counts"
    decimals: int | None = Field(default=None, ge=0, le=9)
    time_unit: Literal["s", "ms", "us"] = "ms"
    time_wrap: float | None = Field(default=None, gt=0.0, le=1e15)
    seq_bits: Literal[8, 16, 32] = 32
    checksum: Literal["none", "xor", "sum"] = "none"
    ignore: tuple[str, ...] = Field(default=(), max_length=16)
    start_command: str = Field(default="", max_length=100)
    debounce_ms: int = Field(default=20, ge=0, le=1000)
    max_speed_rad_s: float = Field(default=20.0, gt=0.0, le=1000.0)
    silence_s: float = Field(default=2.0, ge=0.1, le=60.0)

    @cached_property
    def line_pattern(self) -> LinePattern:
        return LinePattern(
            self.pattern,
            self.unit,
            self.counts_per_turn,
            decimals=self.decimals,
            ticks_per_time=self.tick_rate_hz if self.time_unit == "s" else 1,
            seq_bits=self.seq_bits,
            checksum=self.checksum,
        )

    @property
    def tick_rate_hz(self) -> int:
        return TICKS_PER_S[self.time_unit]

    @property
    def wrap_ticks(self) -> int:
        """Ticks after which the time is 0 again."""
        if self.time_wrap is not None:
            return round(self.time_wrap * UNITS_S[self.time_unit] * self.tick_rate_hz)
        return NEVER_TICKS if self.time_unit == "s" else COUNTER_TICKS

    @model_validator(mode="after")
    def _check_pattern(self) -> "TextLineOptions":
        pattern = self.line_pattern
        if pattern.n_joints != len(self.counts_per_turn):
            raise ValueError(
                f"the pattern has {counted(pattern.n_joints, 'field')} {{joint}}, "
                f"counts_per_turn has {counted(len(self.counts_per_turn), 'value')}; "
                "expected as many"
            )
        if any(not 2 <= counts <= 1 << 32 for counts in self.counts_per_turn):
            raise ValueError("counts_per_turn are 2 to 2^32 each")
        if self.time_wrap is not None:
            if "time" not in pattern.fields:
                raise ValueError("time_wrap is of {time}, which the pattern lacks")
            if self.time_wrap * UNITS_S[self.time_unit] < LEAST_WRAP_S:
                raise ValueError(
                    f"time_wrap {self.time_wrap:g} {self.time_unit} is less than "
                    f"{LEAST_WRAP_S:g} s: times would be ambiguous after an "
                    "interruption; put {skip} in the place of {time}"
                )
        if ("checksum" in pattern.fields) != (self.checksum != "none"):
            raise ValueError(
                'a {checksum} in the pattern and checksum = "xor" or "sum" belong '
                "together; one of them is missing"
            )
        if any(not beginning for beginning in self.ignore):
            raise ValueError("an empty beginning in ignore fits every line; remove it")
        if any(sign in self.start_command for sign in "\r\n"):
            raise ValueError("start_command is one line; its end is added")
        return self

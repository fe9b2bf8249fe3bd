"""What requests set on a board, and the results that it answers with."""

from dataclasses import dataclass

DONE, UNKNOWN_REQUEST, WRONG_LENGTH, RATE_OUT_OF_RANGE = 0, 1, 2, 3
OTHER_MAJOR, OUT_OF_RANGE, NOT_NOW = 4, 5, 6
LONGEST_DEBOUNCE_US = 1_000_000


@dataclass(frozen=True, slots=True)
class Settings:
    """The fields of CONFIGURE; the defaults are those of power-up."""

    edge_mask: int = 0xFF
    heartbeat_ms: int = 1000
    temperature_ms: int = 5000
    debounce_us: int = 5000

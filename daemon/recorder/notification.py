"""What the thread of recordings tells the loop."""

from dataclasses import dataclass
from pathlib import Path

from traverse.daemon.recorder.manual_recording import Recorded


@dataclass(frozen=True, slots=True)
class Told:
    """One of these.

    Attributes:
        flight_failed: a failure of the flight recorder begins, with its reason; or
            ends, "".
        stopped: a recording has ended by itself: what there is of it, and why.
        kept: a file kept after a fault.
    """

    flight_failed: str | None = None
    stopped: tuple[Recorded | None, str] | None = None
    kept: Path | None = None


def reason_of(error: Exception) -> str:
    """Why it was, for people."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or repr(error)

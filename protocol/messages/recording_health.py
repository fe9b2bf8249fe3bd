"""How the recorder is, as a part of health."""

from typing import Literal

from traverse.protocol.messages.fields import Count, Name, Value


class RecordingHealth(Value):
    """Recordings on the daemon's disk."""

    state: Literal["off", "flight", "recording", "failed"]
    """"flight": the last minutes alone; "failed": not even these, see the event."""
    name: Name | None
    """Name of the requested recording; null without one."""
    bytes: Count
    """Length of its file so far."""
    flight_bytes: Count
    """Written by the flight recorder since the daemon's start, before compression."""
    queued: Count
    """Items waiting to be written."""
    dropped: Count
    """Items not recorded because the queue was full."""
    kept: Count
    """Files kept after faults since the daemon's start."""
    kept_dropped: Count
    """Older such files deleted for them."""

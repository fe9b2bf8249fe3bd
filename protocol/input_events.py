"""Events of the kernel's input devices (evdev), as read from /dev/input/event*.

    struct input_event {
        long seconds, microseconds; u16 type, code; s32 value;
    }

in the machine's own byte order and word size: 24 bytes where a long has 8.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

SYN, KEY = 0, 1
"""Types: synchronisation; keys and buttons."""
SYN_REPORT, SYN_DROPPED = 0, 3
"""Codes of `SYN`: a group is complete; the kernel's buffer has run over."""
RELEASED, PRESSED, REPEATED = 0, 1, 2
"""Values of a key."""

_EVENT = struct.Struct("@llHHi")
EVENT_BYTES = _EVENT.size


@dataclass(frozen=True, slots=True)
class InputEvent:
    """One event; its time is of the clock that was set for the device."""

    time_ns: int
    type: int
    code: int
    value: int


class InputEventDecoder:
    """Cuts bytes into events; stores less than one."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> Iterator[InputEvent]:
        data = self._rest + data
        n_complete = len(data) - len(data) % EVENT_BYTES
        self._rest = data[n_complete:]
        for seconds, micros, kind, code, value in _EVENT.iter_unpack(data[:n_complete]):
            yield InputEvent(seconds * 10**9 + micros * 1000, kind, code, value)

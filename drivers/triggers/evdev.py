"""Driver of a foot pedal, a keyboard or a mouse as trigger: the kernel's input events.

Each key named in the configuration is an input. The kernel stamps an event when the
device's report has arrived; the delay of a USB device before that, up to some
milliseconds, is unknown.
"""

import errno
import fcntl
import os
import struct
import time
from collections.abc import Callable, Iterator, Sequence

from pydantic import Field, field_validator

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import DeviceError, DeviceNotFoundError
from traverse.drivers.triggers.trigger_driver import (
    InputChange,
    TriggerDriver,
    TriggerOptions,
)
from traverse.protocol.input_events import (
    KEY,
    RELEASED,
    REPEATED,
    SYN,
    SYN_DROPPED,
    SYN_REPORT,
    InputEventDecoder,
)

MAX_CODE = 0x2FF
# Names and numbers as in the kernel's linux/input-event-codes.h; keys that are missing
# here can be configured by number.

_RUNS = {
    1: "ESC 1 2 3 4 5 6 7 8 9 0 MINUS EQUAL BACKSPACE TAB Q W E R T Y U I O P",
    26: "LEFTBRACE RIGHTBRACE ENTER LEFTCTRL A S D F G H J K L SEMICOLON APOSTROPHE",
    41: "GRAVE LEFTSHIFT BACKSLASH Z X C V B N M COMMA DOT SLASH RIGHTSHIFT",
    55: "KPASTERISK LEFTALT SPACE CAPSLOCK F1 F2 F3 F4 F5 F6 F7 F8 F9 F10",
    69: "NUMLOCK SCROLLLOCK KP7 KP8 KP9 KPMINUS KP4 KP5 KP6 KPPLUS KP1 KP2 KP3 KP0",
    83: "KPDOT",
    87: "F11 F12",
    96: "KPENTER RIGHTCTRL KPSLASH",
    100: "RIGHTALT",
    102: "HOME UP PAGEUP LEFT RIGHT END DOWN PAGEDOWN INSERT DELETE",
    113: "MUTE VOLUMEDOWN VOLUMEUP",
    164: "PLAYPAUSE",
}
_BUTTONS = {
    0x100: "0 1 2 3 4 5 6 7 8 9",
    0x110: "LEFT RIGHT MIDDLE SIDE EXTRA",
    0x120: "TRIGGER THUMB",
    0x130: "SOUTH EAST",
}

KEY_CODES = {
    f"{prefix}_{name}": first + number
    for prefix, runs in (("KEY", _RUNS), ("BTN", _BUTTONS))
    for first, names in runs.items()
    for number, name in enumerate(names.split())
}
READ_BYTES = 4096
KEY_BYTES = MAX_CODE // 8 + 1
# Requests of linux/input.h: direction, size, 'E' and number.
EVIOCSCLOCKID = 0x40000000 | 4 << 16 | ord("E") << 8 | 0xA0
EVIOCGRAB = 0x40000000 | 4 << 16 | ord("E") << 8 | 0x90
EVIOCGKEY = 0x80000000 | KEY_BYTES << 16 | ord("E") << 8 | 0x18


class EvdevOptions(TriggerOptions):
    """Options of the driver `evdev`; ``port`` is best one below /dev/input/by-id.

    Attributes:
        keys: names or numbers of keys; input i is key i.
        exclusive: keep its events from all other programs, if the kernel allows it.
        debounce_us: how long a key must hold its new state.
    """

    keys: tuple[str | int, ...] = Field(min_length=1, max_length=8)
    exclusive: bool = True
    debounce_us: int = Field(default=0, ge=0, le=1_000_000)

    @field_validator("keys")
    @classmethod
    def _check_keys(cls, keys: tuple[str | int, ...]) -> tuple[str | int, ...]:
        codes = [key_code(key) for key in keys]
        for key, code in zip(keys, codes, strict=True):
            if codes.count(code) > 1:
                raise ValueError(f"{key!r} is given twice")
        return keys


def key_code(key: str | int) -> int:
    """The kernel's number of a key.

    Raises:
        ValueError: there is no such key.
    """
    code = KEY_CODES.get(key, -1) if isinstance(key, str) else key
    if not 0 < code <= MAX_CODE:
        raise ValueError(
            f"no key {key!r}; expected a name as KEY_B, KEY_F1 or BTN_LEFT, or the "
            f"number that the program evtest shows, from 1 to {MAX_CODE}"
        )
    return code


class EvdevDriver(TriggerDriver):
    """An input device; input i is key i of ``keys``."""

    options: EvdevOptions
    options_class = EvdevOptions

    def __init__(
        self,
        device: str,
        options: EvdevOptions,
        delivery_queue: DeliveryQueue,
        *,
        ask_kernel: Callable[..., int | bytes] = fcntl.ioctl,
    ) -> None:
        super().__init__(device, options, delivery_queue)
        self._numbers = {key_code(key): n for n, key in enumerate(options.keys)}
        self._ask_kernel = ask_kernel
        self._decoder = InputEventDecoder()
        self._stamps_ours = False
        self._dropped = False

    def _open(self) -> tuple[str, int]:
        try:
            flags = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC
            self._fd = os.open(self._path, flags)
        except OSError as error:
            raise _explain(self._path, error) from error
        self._decoder, self._dropped = InputEventDecoder(), False
        monotonic = struct.pack("@i", time.CLOCK_MONOTONIC)
        self._stamps_ours = self._ioctl(EVIOCSCLOCKID, monotonic) is not None
        if not self._stamps_ours:
            self._fault(
                "times_estimated",
                f"{self._path} does not stamp its events with the monotonic clock; the "
                "time at which they are read is used",
                "use an input device below /dev/input",
            )
        if self.options.exclusive and self._ioctl(EVIOCGRAB, 1) is None:
            self._counters["not_exclusive"] += 1
        return f"keys of {self._path}", self._fd

    def _disconnect(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def _levels(self) -> Sequence[bool]:
        held = self._ioctl(EVIOCGKEY, bytes(KEY_BYTES))
        bits = held if isinstance(held, bytes) else bytes(KEY_BYTES)
        return [bool(bits[code // 8] >> code % 8 & 1) for code in self._numbers]

    def _changes(self) -> Iterator[InputChange]:
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            raise DeviceError(f"{self._path} has gone away", "plug it in again")
        read_ns = self._now_ns()
        for event in self._decoder.feed(data):
            time_ns = event.time_ns if self._stamps_ours else read_ns
            number = self._numbers.get(event.code)
            if event.type == SYN:
                yield from self._synchronised(event.code, time_ns)
            elif self._dropped or event.type != KEY or event.value == REPEATED:
                continue
            elif number is not None:
                yield InputChange(number, event.value != RELEASED, time_ns)

    def _synchronised(self, code: int, time_ns: int) -> Iterator[InputChange]:
        """Drop changes after an overrun until the next report is whole."""
        if code == SYN_DROPPED:
            self._dropped = True
        elif code == SYN_REPORT and self._dropped:
            self._dropped = False
            self._lose_edges(1, "the kernel's buffer ran over")
            for number, active in enumerate(self._levels()):
                yield InputChange(number, active, time_ns)

    def _ioctl(self, request: int, argument: int | bytes) -> int | bytes | None:
        """Return the kernel's answer; None if this file has no such request."""
        try:
            return self._ask_kernel(self._fd, request, argument)
        except OSError:
            return None


def _explain(path: str, error: OSError) -> DeviceNotFoundError:
    remedy = "plug the device in, check its name below /dev/input/by-id"
    reason = error.strerror or str(error)
    if error.errno == errno.ENOENT:
        reason = "there is no such device"
    elif error.errno in (errno.EACCES, errno.EPERM):
        reason = "not permitted"
        remedy = "add the service's user to the group input, or write a udev rule"
    return DeviceNotFoundError(f"cannot open {path}: {reason}", remedy)

"""Driver of GPIO lines as triggers, by libgpiod 2: edges with the kernel's time stamps.

The kernel's debouncing would stamp an edge when it has settled; so every change is
requested, and debounced here, from the first one.
"""

import errno
from collections.abc import Callable, Iterator, Sequence
from typing import Literal

import gpiod
from gpiod.line import Bias, Clock, Direction, Edge, Value
from pydantic import Field, field_validator

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceError,
    DeviceNotFoundError,
    DeviceRefusedError,
)
from traverse.drivers.triggers.trigger_driver import (
    InputChange,
    TriggerDriver,
    TriggerOptions,
)

BUFFER_EVENTS = 256  # that the kernel keeps, for all lines together
CONSUMER = "traverse"

BiasName = Literal["as-is", "disabled", "pull-up", "pull-down"]
BIASES = {
    "as-is": Bias.AS_IS,
    "disabled": Bias.DISABLED,
    "pull-up": Bias.PULL_UP,
    "pull-down": Bias.PULL_DOWN,
}


class GpioOptions(TriggerOptions):
    """Options of the driver `gpio`; ``port`` is the path of the chip.

    Attributes:
        lines: offsets on the chip, or names; input i is line i.
        active_low: the input is active where the voltage is low, as with a button that
            connects the line to ground.
        bias: resistor inside the chip.
    """

    lines: tuple[int | str, ...] = Field(min_length=1, max_length=8)
    active_low: bool = True
    bias: BiasName = "pull-up"

    @field_validator("lines")
    @classmethod
    def _check_lines(cls, lines: tuple[int | str, ...]) -> tuple[int | str, ...]:
        for line in lines:
            if line == "" or (isinstance(line, int) and line < 0):
                raise ValueError(f"{line!r} is no line; expected its offset or name")
            if lines.count(line) > 1:
                raise ValueError(f"{line!r} is given twice")
        return lines


class GpioDriver(TriggerDriver):
    """Lines of one GPIO chip; input i is line i of ``lines``."""

    options: GpioOptions
    options_class = GpioOptions

    def __init__(
        self,
        device: str,
        options: GpioOptions,
        delivery_queue: DeliveryQueue,
        *,
        request: Callable[..., gpiod.LineRequest] = gpiod.request_lines,
    ) -> None:
        super().__init__(device, options, delivery_queue)
        self._names = options.lines
        self._settings = gpiod.LineSettings(
            direction=Direction.INPUT,
            edge_detection=Edge.BOTH,
            bias=BIASES[options.bias],
            active_low=options.active_low,
            event_clock=Clock.MONOTONIC,
        )
        self._request = request
        self._lines: gpiod.LineRequest | None = None
        self._numbers: dict[int, int] = {}
        self._next_seq: dict[int, int] = {}

    def _open(self) -> tuple[str, int]:
        settings = dict.fromkeys(self._names, self._settings)
        try:
            lines = self._request(
                self._path,
                config=settings,
                consumer=CONSUMER,
                event_buffer_size=BUFFER_EVENTS,
            )
        except (OSError, ValueError) as error:
            raise self._explained(error) from error
        self._lines = lines
        self._numbers = {offset: i for i, offset in enumerate(lines.offsets)}
        self._next_seq = {}
        names = ", ".join(map(str, self._names))
        return f"GPIO lines {names} of {self._path}", lines.fd

    def _disconnect(self) -> None:
        if self._lines is not None:
            self._lines.release()
            self._lines = None

    def _levels(self) -> Sequence[bool]:
        return [value is Value.ACTIVE for value in self._open_lines().get_values()]

    def _changes(self) -> Iterator[InputChange]:
        try:
            events = self._open_lines().read_edge_events()
        except OSError as error:
            raise DeviceError(
                f"{self._path} has gone away ({error.strerror or error})",
                "plug it in again",
            ) from error
        for event in events:
            self._check_gap(event)
            # Of the input and not of the voltage: active_low turns it round.
            active = event.event_type is gpiod.EdgeEvent.Type.RISING_EDGE
            number = self._numbers[event.line_offset]
            yield InputChange(number, active, event.timestamp_ns)

    def _check_gap(self, event: gpiod.EdgeEvent) -> None:
        """Check the kernel's numbers of a line's events, which include dropped ones."""
        expected = self._next_seq.get(event.line_offset, 1)
        lost = event.line_seqno - expected
        self._next_seq[event.line_offset] = event.line_seqno + 1
        if lost > 0:
            self._lose_edges(lost, "the kernel's buffer ran over")

    def _open_lines(self) -> gpiod.LineRequest:
        if self._lines is None:
            raise RuntimeError(f"the lines of {self.device} are not open")
        return self._lines

    def _explained(self, error: Exception) -> DeviceError:
        path = self._path
        forbidden = (
            f"cannot open {path}: not permitted",
            "add the service's user to the group gpio, or write a udev rule",
        )
        known = {
            errno.ENOENT: (
                f"cannot open {path}: there is no such chip, or no such line",
                "check the chip's name; gpiodetect lists those that are there",
            ),
            errno.EACCES: forbidden,
            errno.EPERM: forbidden,
            errno.EBUSY: (
                f"a line of {path} is in use by another program",
                "gpioinfo shows by which",
            ),
        }
        if (number := getattr(error, "errno", None)) in known:
            return DeviceNotFoundError(*known[number])
        reason = getattr(error, "strerror", None) or str(error)
        names = ", ".join(map(str, self._names))
        return DeviceRefusedError(
            f"{path} does not give the lines {names} as inputs: {reason}",
            'gpioinfo lists its lines; some chips have no bias: try bias = "as-is"',
        )

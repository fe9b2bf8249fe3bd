"""Base class of listeners to the steps of a measurement.

A step is a delivery, the passing of time, or a command: with its instant, points depend
on nothing else. `traverse.daemon.recorder.recorder.StepRecorder` records them.
"""

from collections.abc import Mapping
from typing import Protocol

from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Message


class StateSource(Protocol):
    """A measurement as listeners see it before a step."""

    @property
    def is_quiet(self) -> bool:
        """Whether a snapshot would be complete."""

    def snapshot(self) -> dict[str, object]:
        """Return the state that a recording begins with."""


class StepListener:
    """Called on the event loop before each step; never waits."""

    def delivered(self, now_ns: int, delivery: Delivery, state: StateSource) -> None:
        """Take a delivery of a device."""

    def passed(self, now_ns: int, state: StateSource) -> None:
        """Take the passing of time."""

    def asked(
        self,
        now_ns: int,
        command: str,
        values: Mapping[str, object],
        state: StateSource,
    ) -> None:
        """Take a command."""

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """Take the present offset from host monotonic time to UTC."""

    def published(self, now_ns: int, message: Message) -> None:
        """Take a message that was queued for publication."""

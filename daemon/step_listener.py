"""Base class of what is notified of each step of a measurement; it ignores them.

A step is a delivery, the passing of time, or a command: with its instant, the steps
are all that points depend on. `traverse.daemon.recorder.recorder.StepRecorder` records
them.
"""

from collections.abc import Mapping
from typing import Protocol

from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Message


class StateSource(Protocol):
    """What measures, as far as a listener may look at it before a step."""

    @property
    def is_quiet(self) -> bool:
        """Nothing is under way that a snapshot does not contain."""

    def snapshot(self) -> dict[str, object]:
        """All that a recording which begins now must know."""


class StepListener:
    """Called on the event loop before each step; never waits."""

    def delivered(self, now_ns: int, delivery: Delivery, state: StateSource) -> None:
        """A device has delivered something."""

    def passed(self, now_ns: int, state: StateSource) -> None:
        """Time has passed."""

    def asked(
        self, now_ns: int, what: str, values: Mapping[str, object], state: StateSource
    ) -> None:
        """A request was executed."""

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """UTC is so much more than host monotonic time from now on."""

    def published(self, now_ns: int, message: Message) -> None:
        """A message has been queued to be published."""

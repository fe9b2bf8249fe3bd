"""What is told of everything that measuring does, in order; this one forgets it.

A step is a delivery, the passing of time, or a command: with its instant, the steps
are all that points depend on. `traverse.daemon.recorder.recorder.Recorder` keeps them.
"""

from collections.abc import Mapping

from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Message


class StepListener:
    """Takes what it is told, on the event loop, and never waits."""

    def delivered(self, now_ns: int, delivery: Delivery) -> None:
        """A device has delivered something."""

    def passed(self, now_ns: int) -> None:
        """Time has passed."""

    def asked(self, now_ns: int, what: str, values: Mapping[str, object]) -> None:
        """Somebody has asked for something."""

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """UTC is so much more than host monotonic time from now on."""

    def published(self, now_ns: int, message: Message) -> None:
        """A message has been handed on to be published."""

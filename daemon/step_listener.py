"""No-op base class for listeners to the steps of measuring, in order.

A step is a delivery, the passing of time, or a command: with its instant, the steps
are all that points depend on. `traverse.daemon.recorder.recorder.Recorder` keeps them.
"""

from collections.abc import Mapping

from traverse.drivers.base.values import Delivery
from traverse.protocol.messages import Message


class StepListener:
    """Receive notifications on the event loop, without waiting."""

    def delivered(self, now_ns: int, delivery: Delivery) -> None:
        """A device has delivered something."""

    def passed(self, now_ns: int) -> None:
        """Time has passed."""

    def asked(self, now_ns: int, what: str, values: Mapping[str, object]) -> None:
        """A request was executed."""

    def related(self, now_ns: int, utc_offset_ns: int) -> None:
        """UTC is so much more than host monotonic time from now on."""

    def published(self, now_ns: int, message: Message) -> None:
        """A message has been handed on to be published."""

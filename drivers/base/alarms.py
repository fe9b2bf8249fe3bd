"""Alarms of a device, delivered at begin and end."""

from collections.abc import Callable
from dataclasses import replace

from traverse.drivers.base.values import DeviceAlarm


class Alarms:
    """Raised alarms, by channel (None: the whole device) and code.

    An alarm without room is delivered by the next call that repeats it.
    """

    def __init__(self, device: str, put: Callable[[DeviceAlarm], bool]) -> None:
        self._device, self._put = device, put
        self._raised: dict[tuple[int | None, str], DeviceAlarm] = {}

    def is_raised(self, channel: int | None, code: str) -> bool:
        return (channel, code) in self._raised

    def begin(
        self, channel: int | None, code: str, text: str, remedy: str, value: int = 0
    ) -> None:
        """Raise an alarm; a raised one is reported again with a new text."""
        alarm = DeviceAlarm(self._device, channel, True, code, text, value, remedy)
        if self._raised.get((channel, code)) != alarm and self._put(alarm):
            self._raised[channel, code] = alarm

    def end(self, channel: int | None, code: str) -> None:
        alarm = self._raised.get((channel, code))
        if alarm is not None and self._put(replace(alarm, raised=False)):
            del self._raised[channel, code]

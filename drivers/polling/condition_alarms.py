"""What encoders complain of: conditions that begin and end, as alarms."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from traverse.drivers.base.values import DeviceAlarm

TELL_NS = 200_000_000  # a condition that comes and goes is told so often at most


@dataclass(frozen=True, slots=True)
class Condition:
    """What may be wrong with an encoder: in words, and what to do."""

    text: str
    remedy: str


class ConditionAlarms:
    """The conditions of one device's encoders; lives as long as its driver.

    Args:
        device: id in the configuration.
        put: hands an alarm over; False where there is no room.
        conditions: by the code of the alarm.
    """

    def __init__(
        self,
        device: str,
        put: Callable[[DeviceAlarm], bool],
        conditions: Mapping[str, Condition],
    ) -> None:
        self._device = device
        self._put = put
        self._conditions = conditions
        self._seen: set[tuple[int, str]] = set()
        self._raised: set[tuple[int, str]] = set()
        self._heard: set[int] = set()
        self._told_ns = 0

    def add(self, channel: int, codes: Iterable[str]) -> None:
        """An encoder has said what it complains of, perhaps nothing."""
        self._heard.add(channel)
        self._seen.update((channel, code) for code in codes)

    def report(self, names: Mapping[int, str], now_ns: int) -> None:
        """Tell what has begun, and what has not been seen since the last time.

        Args:
            names: of the encoders, by channel, for people.
            now_ns: the host's clock.
        """
        if now_ns - self._told_ns < TELL_NS:
            return
        self._told_ns = now_ns
        for channel, code in sorted(self._seen - self._raised):
            if self._put(self._alarm(channel, code, names, True)):
                self._raised.add((channel, code))
        for channel, code in sorted(self._raised - self._seen):
            if channel in self._heard and self._put(
                self._alarm(channel, code, names, False)
            ):
                self._raised.discard((channel, code))
        self._seen.clear()
        self._heard.clear()

    def _alarm(
        self, channel: int, code: str, names: Mapping[int, str], raised: bool
    ) -> DeviceAlarm:
        condition = self._conditions[code]
        words = condition.text if raised else f"no more {condition.text}"
        text = f"{names[channel]}: {words}"
        remedy = condition.remedy
        return DeviceAlarm(self._device, channel, raised, code, text, 0, remedy)

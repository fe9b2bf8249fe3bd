"""Alarms of polled encoders: readings that failed, and what encoders complain of."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from traverse.drivers.base.values import DeviceAlarm, DeviceError, DeviceFault
from traverse.drivers.polling.channel import UNCONFIRMED, PolledChannel, ReadError
from traverse.plurals import counted

REPORT_INTERVAL_NS = 200_000_000  # so often at most, together


class ReadErrorLog:
    """Alarms of the encoders of one device; lives as long as its driver."""

    def __init__(
        self,
        device: str,
        put: Callable[[DeviceAlarm | DeviceFault], bool],
        counters: Counter[str],
    ) -> None:
        self._device = device
        self._put = put
        self._counters = counters
        self._last: dict[int, ReadError] = {}
        self._untold: Counter[tuple[str, ReadError]] = Counter()
        self._told_ns = 0
        self._alarms: dict[int, ReadError] = {}  # raised and not yet cleared

    def add(self, number: int, channel: PolledChannel, miss: ReadError) -> None:
        """A reading of channel ``number`` has failed."""
        self._counters[miss.code] += 1
        if miss is UNCONFIRMED:
            return
        self._counters[f"missed_{number}"] += 1
        self._last[number] = miss
        if not channel.missing:  # else an alarm reports it once
            self._untold[channel.name, miss] += 1

    def raise_if_all_missing(self, channels: Sequence[PolledChannel]) -> None:
        """Raise DeviceError where no encoder is left that can be read."""
        if all(channel.missing for channel in channels):
            miss = self._last[0]
            raise DeviceError(
                f"none of {counted(len(channels), 'encoder')} of {self._device} can "
                "be read: "
                f"{channels[0].name} {miss.text}",
                miss.remedy,
            )

    def report(self, channels: Sequence[PolledChannel], now_ns: int) -> None:
        """Alarms that begin and end; single misses now and then."""
        for number, channel in enumerate(channels):
            if channel.missing and number not in self._alarms:
                miss = self._last[number]
                text = f"{channel.name} {miss.text}"
                if self._put(self._alarm(number, True, text, miss, channel.misses)):
                    self._alarms[number] = miss
            elif channel.time_ns is not None and number in self._alarms:
                miss = self._alarms[number]
                text = f"{channel.name} is read again"
                if self._put(self._alarm(number, False, text, miss, 0)):
                    del self._alarms[number]
        if self._untold and now_ns - self._told_ns >= REPORT_INTERVAL_NS:
            self._told_ns = now_ns
            for (name, miss), count in self._untold.items():
                text = f"{name} {miss.text}"
                self._fault("readings_missing", text, miss.remedy, count)
            self._untold.clear()

    def _fault(self, code: str, text: str, remedy: str, count: int) -> None:
        self._put(DeviceFault(self._device, code, text, remedy, count))

    def _alarm(
        self, number: int, raised: bool, text: str, miss: ReadError, misses: int
    ) -> DeviceAlarm:
        remedy = miss.remedy if raised else ""
        return DeviceAlarm(
            self._device, number, raised, "encoder_missing", text, misses, remedy
        )


@dataclass(frozen=True, slots=True)
class Condition:
    """One fault of an encoder: in words, with the remedy."""

    text: str
    remedy: str


class ConditionAlarms:
    """The conditions of one device's encoders; lives as long as its driver."""

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
        """An encoder has reported its alarms, perhaps none."""
        self._heard.add(channel)
        self._seen.update((channel, code) for code in codes)

    def report(self, names: Mapping[int, str], now_ns: int) -> None:
        """Report what has begun, and what has not recurred since the last call."""
        if now_ns - self._told_ns < REPORT_INTERVAL_NS:
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

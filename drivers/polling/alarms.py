"""Alarms of polled encoders: failed readings, and reported conditions."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence

from traverse.drivers.base.alarms import Alarms
from traverse.drivers.base.values import DeviceAlarm, DeviceError, DeviceFault
from traverse.drivers.polling.channel import UNCONFIRMED, PolledChannel, ReadError
from traverse.plurals import counted

REPORT_INTERVAL_NS = 200_000_000  # so often at most, together
MISSING = "encoder_missing"


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
        self._alarms = Alarms(device, put)

    def add(self, number: int, channel: PolledChannel, miss: ReadError) -> None:
        self._counters[miss.code] += 1
        if miss is UNCONFIRMED:
            return
        self._counters[f"missed_{number}"] += 1
        self._last[number] = miss
        if not channel.missing:  # else an alarm reports it once
            self._untold[channel.name, miss] += 1

    def raise_if_all_missing(self, channels: Sequence[PolledChannel]) -> None:
        """Raise DeviceError if no encoder can be read."""
        if all(channel.missing for channel in channels):
            miss = self._last[0]
            raise DeviceError(
                f"none of {counted(len(channels), 'encoder')} of {self._device} can "
                "be read: "
                f"{channels[0].name} {miss.text}",
                miss.remedy,
            )

    def report(self, channels: Sequence[PolledChannel], now_ns: int) -> None:
        for number, channel in enumerate(channels):
            if channel.missing and not self._alarms.is_raised(number, MISSING):
                miss = self._last[number]
                text = f"{channel.name} {miss.text}"
                self._alarms.begin(number, MISSING, text, miss.remedy, channel.misses)
            elif channel.time_ns is not None:
                self._alarms.end(number, MISSING)
        if self._untold and now_ns - self._told_ns >= REPORT_INTERVAL_NS:
            self._told_ns = now_ns
            for (name, miss), count in self._untold.items():
                code, text = "readings_missing", f"{name} {miss.text}"
                self._put(DeviceFault(self._device, code, text, miss.remedy, count))
            self._untold.clear()


class ConditionAlarms:
    """The conditions of one device's encoders; lives as long as its driver.

    ``conditions`` has text and remedy by code.
    """

    def __init__(
        self,
        device: str,
        put: Callable[[DeviceAlarm], bool],
        conditions: Mapping[str, tuple[str, str]],
    ) -> None:
        self._conditions = conditions
        self._alarms = Alarms(device, put)
        self._seen: dict[int, set[str]] = {}
        self._told_ns = 0

    def add(self, channel: int, codes: Iterable[str]) -> None:
        """Take the alarms reported by an encoder, perhaps none."""
        self._seen.setdefault(channel, set()).update(codes)

    def report(self, names: Mapping[int, str], now_ns: int) -> None:
        """Report conditions that have begun, or not recurred since the last call."""
        if now_ns - self._told_ns < REPORT_INTERVAL_NS:
            return
        self._told_ns = now_ns
        for channel, codes in sorted(self._seen.items()):
            for code, (words, remedy) in self._conditions.items():
                if code in codes:
                    text = f"{names[channel]}: {words}"
                    self._alarms.begin(channel, code, text, remedy)
                else:
                    self._alarms.end(channel, code)
        self._seen.clear()

"""Devices whose encoders are not read anew each time.

One repeated count may be chance, or a joint that sticks; two, or one that no hand could
make, are a fault. Then every number is in doubt, since in slow motion and at rest an
old count cannot be told from a new one. It ends when the joints have been led for long
enough so that another one would have shown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np

from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.published import PublishedNumbers
from traverse.drivers.base.values import CountSamples, RepeatedCount
from traverse.drivers.polling.repeats import RepeatDetector
from traverse.plurals import counted
from traverse.protocol.messages import QualityFlag

CONDITION = "single_readings"  # that this feeds
TWO_NS = 30_000_000_000  # within which two are no chance
LED_NS = 20_000_000_000  # that each of the joints is led without another one


class RepeatMonitor:
    """Feeds the condition `single_readings`."""

    def __init__(
        self, conditions: ConditionMonitor, published: PublishedNumbers
    ) -> None:
        self._conditions, self._published = conditions, published
        self._detectors: dict[str, tuple[list[int], RepeatDetector]] = {}
        self._recent: dict[str, list[RepeatedCount]] = {}
        # Of devices in doubt, by channel: how long it has been led since the latest.
        self._led_ns: dict[str, dict[int, int]] = {}

    @property
    def state(self) -> dict[str, Any]:
        return {
            "recent": {
                device: [list(astuple(repeat)) for repeat in repeats]
                for device, repeats in self._recent.items()
            },
            "led_ns": {
                device: [list(item) for item in led_ns.items()]
                for device, led_ns in self._led_ns.items()
            },
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        self._recent = {
            device: [RepeatedCount(*values) for values in repeats]
            for device, repeats in state["recent"].items()
        }
        self._led_ns = {
            device: {int(channel): int(led_ns) for channel, led_ns in items}
            for device, items in state["led_ns"].items()
        }

    def is_in_doubt(self, device: str) -> bool:
        return device in self._led_ns

    def begin(self, device: str) -> None:
        """Begin the observation of a device anew, which may be another one."""
        self._detectors.pop(device, None)

    def begin_all(self) -> None:
        """Begin anew with an arm of other encoders, without any doubt."""
        self._detectors.clear()
        self._recent.clear()
        self._led_ns.clear()

    def add(
        self, model: ArmModel, samples: CountSamples, moduli_counts: Sequence[int]
    ) -> list[RepeatedCount]:
        """Check the readings of a device, whose counts wrap there."""
        device = samples.device
        if device not in self._detectors:
            self._detectors[device] = _new_detector(model, device, moduli_counts)
        channels, detector = self._detectors[device]
        repeats = detector.add(samples)
        if device in self._led_ns:
            self._follow(device, channels, detector)
        if repeats:
            self.take(model, repeats)
        return repeats

    def _follow(
        self, device: str, channels: Sequence[int], detector: RepeatDetector
    ) -> None:
        led_ns = self._led_ns[device]
        period_ns = min(repeat.period_ns for repeat in self._recent[device])
        for channel in led_ns:
            led_ns[channel] += detector.led_ns(channels.index(channel), period_ns)
        if min(led_ns.values()) >= LED_NS:
            del self._led_ns[device], self._recent[device]
            text = f"{device} has repeated no count in {LED_NS / 1e9:g} s of motion"
            self._conditions.establish(CONDITION, device, text)

    def take(self, model: ArmModel, repeats: Sequence[RepeatedCount]) -> None:
        """Take repeats of one device, also those that its driver has found."""
        device = repeats[0].device
        repeats = [r for r in repeats if model.joint_of(device, r.channel)]
        if not repeats:
            return
        latest_ns = max(repeat.until_ns for repeat in repeats)
        recent = [
            repeat
            for repeat in (*self._recent.get(device, ()), *repeats)
            if latest_ns - repeat.until_ns <= TWO_NS
        ]
        self._recent[device] = recent
        # Several joints at once are one failure, and may be one chance.
        n_times = len({repeat.since_ns for repeat in recent})
        is_clear = any(repeat.is_clear for repeat in repeats)
        before = self._led_ns.get(device)
        if before is None and n_times < 2 and not is_clear:
            return
        repeated = {repeat.channel for repeat in recent}
        self._led_ns[device] = {**(before or {}), **dict.fromkeys(repeated, 0)}
        if before is None or not repeated <= before.keys():
            self._doubt(model, device, recent)

    def _doubt(
        self, model: ArmModel, device: str, recent: Sequence[RepeatedCount]
    ) -> None:
        """Put numbers in doubt; name those that were published before it showed."""
        since_ns = min(repeat.since_ns for repeat in recent)
        until_ns = max(repeat.until_ns for repeat in recent)
        n_readings = sum(repeat.n_readings for repeat in recent)
        most_rad = max(abs(repeat.off_rad) for repeat in recent)
        named = ", ".join(
            f"{model.joint_of(device, channel)} ({device}/{channel})"
            for channel in sorted({repeat.channel for repeat in recent})
        )
        text, data = self._published.between(since_ns, until_ns, QualityFlag.STALE)
        seconds = round((until_ns - since_ns) * 1e-9, 3)
        self._conditions.doubt(
            CONDITION,
            device,
            f"{counted(n_readings, 'reading')} of {named} within {seconds:g} s "
            f"repeated the count before, up to {1e3 * most_rad:.2g} mrad off, while "
            f"the joint moved on{text}",
            {**data, "readings": n_readings},
        )


def _new_detector(
    model: ArmModel, device: str, moduli_counts: Sequence[int]
) -> tuple[list[int], RepeatDetector]:
    joints = [j for j, name in enumerate(model.joint_devices) if name == device]
    channels = model.channels[joints]
    wraps_counts = model.wraps_counts({device: moduli_counts})[joints]
    count_rad = np.abs(model.per_count_rad[joints])
    detector = RepeatDetector(device, channels, wraps_counts, count_rad)
    return channels.tolist(), detector

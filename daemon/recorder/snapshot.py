"""What a recording that begins in the middle has to know of the time before.

The last seconds of the stream are not part of it: who continues from a state has to
be given some seconds more before all points are as they were (`WARM_UP_NS`).
"""

from traverse.drivers.base.delivery_maps import delivery_kind, delivery_to_map
from traverse.drivers.base.values import (
    Delivery,
    DeviceAlarm,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    StreamStarted,
)

WARM_UP_NS = 6_000_000_000
"""Readings, poses and motion are remembered for less."""


class DeviceSnapshot:
    """The deliveries that together give the devices' current state."""

    def __init__(self) -> None:
        self._told: dict[str, dict[object, Delivery]] = {}

    def note(self, delivery: Delivery) -> None:
        """Something has been delivered."""
        told = self._told.setdefault(delivery.device, {})
        match delivery:
            case DeviceUp():
                told.clear()
                told["up"] = delivery
            case DeviceLost() | StreamStarted() | DeviceTemperatures():
                kind = delivery_kind(delivery)
                told.pop(kind, None)
                told[kind] = delivery
            case DeviceAlarm():
                alarm = ("alarm", delivery.channel, delivery.code)
                told.pop(alarm, None)
                if delivery.raised:
                    told[alarm] = delivery

    def maps(self) -> list[dict[str, object]]:
        """All of them, each device's in order."""
        found = []
        for told in self._told.values():
            for delivery in told.values():
                table = delivery_to_map(delivery)
                if isinstance(delivery, DeviceUp):
                    table["restarted"] = False  # what it made is in the state already
                found.append(table)
        return found

"""What a recording that begins in the middle has to know of the time before.

The last seconds of the stream are not part of it: whoever goes on from a state has to
be given some seconds more before all points are as they were (`WARM_UP_NS`).
"""

from collections.abc import Mapping
from typing import Any

from traverse.daemon.delivery_dispatcher import Measuring
from traverse.daemon.points.capture import Capture
from traverse.daemon.pose.arm_model import ArmModel
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
MOST_TEMPERATURES = 1000


class DeviceSnapshot:
    """The deliveries that together say how the devices are now."""

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


class MeasurementSnapshot:
    """Says how measuring is at this moment.

    Args:
        measuring: what measures.
        capture: where points are numbered.

    Attributes:
        probe: the probe that was chosen, as JSON; None for that of the arm file.
    """

    def __init__(self, measuring: Measuring, capture: Capture) -> None:
        self._measuring = measuring
        self._capture = capture
        self.probe: str | None = None

    @property
    def is_idle(self) -> bool:
        """Nothing is under way that a state would have to tell."""
        return self._measuring.is_idle and not self._measuring.scans.is_running

    def state(self) -> dict[str, object]:
        """All of it, as plain values and arrays."""
        measuring, capture = self._measuring, self._capture
        air_mm = measuring.points.tip.air_mm
        alignment = capture.part.alignment
        temperatures = measuring.quality.persistent.temperatures
        return {
            "idle": self.is_idle,
            "model": measuring.model.digest,
            "probe": self.probe,
            "session": capture.session.id,
            "next_seq": capture.session.next_seq,
            "label": capture.label.model_dump(),
            "alignment": None
            if alignment is None
            else {
                "name": alignment.name,
                "rotation": alignment.rotation,
                "translation_mm": alignment.translation_mm,
                "scale": alignment.scale,
            },
            "air_mm": None if air_mm is None else air_mm.tolist(),
            "temperatures": temperatures[-MOST_TEMPERATURES:],
            "pipeline": measuring.pipeline_state,
        }


def check_model(state: Mapping[str, Any], model: ArmModel) -> None:
    """See that a state is of this arm.

    Raises:
        ValueError: it is not.
    """
    if state["model"] != model.digest:
        raise ValueError(
            f"the recording's state is of model {str(state['model'])[:12]}, its arm "
            f"file gives {model.digest[:12]}"
        )

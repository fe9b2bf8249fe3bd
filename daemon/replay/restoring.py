"""A measurement that continues from the state that a recording begins with."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from traverse.daemon.measurement import Measurement
from traverse.daemon.pose.alignment import Alignment
from traverse.daemon.pose.probe_library import LibraryProbe
from traverse.drivers.base.delivery_maps import delivery_from_map
from traverse.protocol.messages import Label


def restore(measurement: Measurement, state: Mapping[str, Any]) -> None:
    """Continue from a recorded state, with its devices and `fresh`.

    Raises:
        ValueError: it is of another arm.
        KeyError: something is missing.
    """
    if state["model"] != measurement.model.digest:
        raise ValueError(
            f"the recording's state is of model {str(state['model'])[:12]}, its "
            f"arm file gives {measurement.model.digest[:12]}"
        )
    for delivery in map(delivery_from_map, state["devices"]):
        if delivery.device in measurement.devices:
            measurement.dispatch(measurement.devices[delivery.device], delivery)
    measurement.references.resume(state["references"])
    if not state["fresh"]:
        measurement.pipeline.resume(state["pipeline"])
        measurement.reading_monitors.resume(state)
    if state["probe"] is not None:
        measurement.probe = LibraryProbe.model_validate_json(state["probe"])
    measurement.capture.session.id = state["session"]
    measurement.capture.session.next_seq = state["next_seq"]
    measurement.capture.label = Label(**state["label"])
    if state["alignment"] is not None:
        measurement.alignment.alignment = Alignment(**state["alignment"])
    if state["air_mm"] is not None:
        measurement.points.evaluator.tip.air_mm = np.array(state["air_mm"])
    measurement.quality.persistent.resume(state["temperatures"])
    measurement.conditions.resume(state["conditions"])
    measurement.utc.doubt, measurement.utc.remedy = state.get("utc_doubt", ("", ""))

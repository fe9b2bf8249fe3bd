"""Statements of a certificate besides figures: who, where, when, which standards."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.artefacts import Artefact
from traverse.lab.measured_points.measurement import Measurement
from traverse.lab.report.provenance import utc_text


def administration_of(measured: Sequence[Measurement], arm: Arm) -> dict[str, Any]:
    """Collect what campaign and arm file state, as plain values.

    Times are ISO 8601 with Z, of the first and the last touch; temperatures are those
    of all touches. None stands where something is not stated. There are `tools` where
    the campaign names any.
    """
    occasion = measured[0].occasion
    firsts = [at for one in measured if (at := one.occasion.first_utc) is not None]
    lasts = [at for one in measured if (at := one.occasion.last_utc) is not None]
    warm_c = np.concatenate([one.temperature_c for one in measured])
    known = bool(len(warm_c))
    identified = arm.identification and arm.identification.date
    touched = {
        name: artefact
        for name, artefact in measured[0].artefacts.items()
        if any(len(one.of(name)) for one in measured)
    }
    tools = [
        {"name": one.tool.name, "vector_mm": list(one.tool.vector_mm or ())}
        for one in measured
        if one.tool is not None
    ]
    return {
        "operator": occasion.operator,
        "place": occasion.place,
        "measured_from_utc": utc_text(min(firsts)) if firsts else None,
        "measured_to_utc": utc_text(max(lasts)) if lasts else None,
        "temperature_least_c": float(warm_c.min()) if known else None,
        "temperature_mean_c": float(warm_c.mean()) if known else None,
        "temperature_largest_c": float(warm_c.max()) if known else None,
        "arm_name": arm.name,
        "arm_serial_number": arm.serial_number,
        "arm_calibration_date": str(identified) if identified else None,
        "standards": _standards(touched),
        **({"tools": tools} if tools else {}),
    }


def _standards(artefacts: Mapping[str, Artefact]) -> list[dict[str, Any]]:
    """Name each standard once, however many places it was touched in."""
    found: dict[tuple[str | None, ...], dict[str, Any]] = {}
    for name, artefact in artefacts.items():
        if artefact.kind in ("cone", "plane"):
            continue  # not calibrated
        calibrated = artefact.calibration_date
        own: dict[str, Any] = {
            "kind": artefact.kind,
            "artefacts": [],
            "serial_number": artefact.serial_number,
            "calibration_date": None if calibrated is None else calibrated.isoformat(),
            "certificate_number": artefact.certificate_number,
        }
        identity = tuple(text for key, text in own.items() if key != "artefacts")
        found.setdefault(identity, own)["artefacts"].append(name)
    return list(found.values())

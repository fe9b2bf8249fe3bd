"""Statements of a certificate besides figures: who, where, when, which standards."""

from collections.abc import Mapping
from typing import Any

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.artefacts import Artefact
from traverse.lab.measured_points.measurement import Measurement
from traverse.lab.report.provenance import utc_text


def administration_of(measured: Measurement, arm: Arm) -> dict[str, Any]:
    """Collect what campaign and arm file state, as plain values.

    Times are ISO 8601 with Z, of the first and the last touch; temperatures are those
    of all touches. None stands where something is not stated.
    """
    occasion, warm_c = measured.occasion, measured.temperature_c
    first, last = occasion.first_utc, occasion.last_utc
    known = bool(len(warm_c))
    identified = arm.identification and arm.identification.date
    touched = {
        name: artefact
        for name, artefact in measured.artefacts.items()
        if len(measured.of(name))
    }
    return {
        "operator": occasion.operator,
        "place": occasion.place,
        "measured_from_utc": first and utc_text(first),
        "measured_to_utc": last and utc_text(last),
        "temperature_least_c": float(warm_c.min()) if known else None,
        "temperature_mean_c": float(warm_c.mean()) if known else None,
        "temperature_largest_c": float(warm_c.max()) if known else None,
        "arm_name": arm.name,
        "arm_serial_number": arm.serial_number,
        "arm_calibration_date": str(identified) if identified else None,
        "standards": _standards(touched),
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

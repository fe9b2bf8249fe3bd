"""Statements of a certificate besides figures: who, where, when, which standards."""

from collections.abc import Mapping
from dataclasses import dataclass

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.artefacts import Artefact
from traverse.lab.measured_points.measurement import Measurement
from traverse.lab.report.provenance import utc_text


@dataclass(frozen=True, slots=True)
class StandardUsed:
    """A calibrated standard; None where the campaign does not state it.

    Attributes:
        artefacts: Ids of the places where it was touched.
        calibration_date: ISO 8601.
    """

    kind: str
    artefacts: tuple[str, ...]
    serial_number: str | None
    calibration_date: str | None
    certificate_number: str | None


@dataclass(frozen=True, slots=True)
class Administration:
    """The administrative data of a certificate; None where something is not stated.

    Attributes:
        measured_from_utc: First touch, ISO 8601 with Z.
        measured_to_utc: Last touch.
        temperature_least_c: Lowest temperature of a touch.
        temperature_mean_c: Mean over the touches.
        temperature_largest_c: Highest.
        arm_calibration_date: When the arm was identified.
    """

    operator: str | None
    place: str | None
    measured_from_utc: str | None
    measured_to_utc: str | None
    temperature_least_c: float | None
    temperature_mean_c: float | None
    temperature_largest_c: float | None
    arm_name: str
    arm_serial_number: str | None
    arm_calibration_date: str | None
    standards: tuple[StandardUsed, ...]


def administration_of(measured: Measurement, arm: Arm) -> Administration:
    """Collect what campaign and arm file state."""
    occasion, warm_c = measured.occasion, measured.temperature_c
    known = bool(len(warm_c))
    identified = arm.identification and arm.identification.date
    touched = {
        name: artefact
        for name, artefact in measured.artefacts.items()
        if len(measured.of(name))
    }
    return Administration(
        operator=occasion.operator,
        place=occasion.place,
        measured_from_utc=utc_text(occasion.first_utc),
        measured_to_utc=utc_text(occasion.last_utc),
        temperature_least_c=float(warm_c.min()) if known else None,
        temperature_mean_c=float(warm_c.mean()) if known else None,
        temperature_largest_c=float(warm_c.max()) if known else None,
        arm_name=arm.name,
        arm_serial_number=arm.serial_number,
        arm_calibration_date=str(identified) if identified else None,
        standards=_standards(touched),
    )


def _standards(artefacts: Mapping[str, Artefact]) -> tuple[StandardUsed, ...]:
    """Name each standard once, however many places it was touched in."""
    places: dict[tuple[str, str | None, str | None, str | None], list[str]] = {}
    for name, artefact in artefacts.items():
        if artefact.kind in ("cone", "plane"):
            continue  # not calibrated
        calibrated = artefact.calibration_date
        identity = (
            artefact.kind,
            artefact.serial_number,
            None if calibrated is None else calibrated.isoformat(),
            artefact.certificate_number,
        )
        places.setdefault(identity, []).append(name)
    return tuple(
        StandardUsed(kind, tuple(names), *rest)
        for (kind, *rest), names in places.items()
    )

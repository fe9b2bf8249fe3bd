"""Statements of a certificate besides figures: who, where, when, with what."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import date

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.acceptance.limits import Limits, Mpe
from traverse.lab.acceptance.procedures.belonging import FARTHEST
from traverse.lab.artefacts import Artefact
from traverse.lab.artefacts.artefact import ExpandingArtefact
from traverse.lab.artefacts.materials import MaterialName
from traverse.lab.artefacts.plane import Plane
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.measured_points.measurement import (
    IncompleteError,
    Measurement,
    certified_length,
    copied_touches,
)
from traverse.lab.report.provenance import utc_text
from traverse.lab.report.quantities import OMITTED


@dataclass(frozen=True, slots=True)
class StandardUsed:
    """A material standard, however many places it was touched in.

    Attributes:
        artefacts: Ids of these places.
        calibration_date: ISO 8601.
        valid_until: Last day of its certificate.
        expansion_per_c: Stated, or that of the material.
        expansion_std_per_c: Standard uncertainty of that.
    """

    kind: str
    artefacts: tuple[str, ...]
    serial_number: str | None
    calibration_date: str | None
    certificate_number: str | None
    calibrated_by: str | None
    valid_until: str | None
    material: MaterialName | None
    expansion_per_c: float | None
    expansion_std_per_c: float | None

    @property
    def name(self) -> str:
        """Its kind and serial number, else where it was touched."""
        kind = self.kind.replace("_", " ")
        if self.serial_number:
            return f"{kind} {self.serial_number}"
        more = len(self.artefacts) - 3
        places = ", ".join(self.artefacts[:3]) + (
            f" and {more} more" if more > 0 else ""
        )
        return f"{kind} ({places})"


@dataclass(frozen=True, slots=True)
class ToolUsed:
    """A tool that poses name, with its vector as given."""

    name: str
    vector_mm: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Administration:
    """What campaign, arm file and limits state; None where they do not.

    Attributes:
        measured_from_utc: Of the first touch, ISO 8601 with Z.
        temperature_least_c: Of all touches, as the next two.
        temperature_std_c: Standard uncertainty of these.
        probe_diameter_mm: Of the ball; 0 of a sensor, whose points are on the surface.
        probe_length_mm: From the last joint to the centre of the ball.
        measuring_range_mm: Diameter of the volume that shares of a length refer to.
        reach_mm: From the shoulder, which shares of zones refer to.
        longest_mm: Certified length of the longest standard.
        too_large_limits: Their keys, and values at the length of the reach.
        copied_touches: How many are where another was, to the last digit, if many.
        is_of_identification: Whether the arm was identified from these very touches.
    """

    operator: str | None
    place: str | None
    measured_from_utc: str | None
    measured_to_utc: str | None
    temperature_least_c: float | None
    temperature_mean_c: float | None
    temperature_largest_c: float | None
    temperature_std_c: float | None
    humidity_percent: float | None
    pressure_hpa: float | None
    warm_up_min: float | None
    probe: str | None
    probe_diameter_mm: float
    probe_length_mm: float
    arm_name: str
    arm_serial_number: str | None
    arm_calibration_date: str | None
    measuring_range_mm: float | None
    reach_mm: float
    next_date: str | None
    standards: tuple[StandardUsed, ...]
    tools: tuple[ToolUsed, ...] | None = field(default=None, metadata=OMITTED)
    longest_mm: float | None = field(default=None, metadata=OMITTED)
    too_large_limits: tuple[str, ...] | None = field(default=None, metadata=OMITTED)
    agreement: str | None = field(default=None, metadata=OMITTED)
    copied_touches: int | None = field(default=None, metadata=OMITTED)
    is_of_identification: bool | None = field(default=None, metadata=OMITTED)


def administration_of(
    measured: Sequence[Measurement], arm: Arm, limits: Limits
) -> Administration:
    """Collect what campaign, arm file and limits state.

    Standards are those that were touched; all, while nothing was.
    """
    occasion = measured[0].occasion
    circumstances = occasion.circumstances
    occasions = [measurement.occasion for measurement in measured]
    firsts = [each.first_utc for each in occasions if each.first_utc is not None]
    lasts = [each.last_utc for each in occasions if each.last_utc is not None]
    warm_c = np.concatenate([measurement.temperature_c for measurement in measured])
    known = bool(len(warm_c))
    identified = arm.identification and arm.identification.date
    touched = {
        name: artefact
        for name, artefact in measured[0].artefacts.items()
        if any(len(measurement.of(name)) for measurement in measured)
    } or measured[0].artefacts
    tools = tuple(
        ToolUsed(measurement.tool.name, tuple(measurement.tool.vector_mm or ()))
        for measurement in measured
        if measurement.tool is not None
    )
    return Administration(
        operator=occasion.operator,
        place=occasion.place,
        measured_from_utc=utc_text(min(firsts)) if firsts else None,
        measured_to_utc=utc_text(max(lasts)) if lasts else None,
        temperature_least_c=float(warm_c.min()) if known else None,
        temperature_mean_c=float(warm_c.mean()) if known else None,
        temperature_largest_c=float(warm_c.max()) if known else None,
        temperature_std_c=limits.standards.temperature_std_c or None,
        humidity_percent=circumstances.humidity_percent,
        pressure_hpa=circumstances.pressure_hpa,
        warm_up_min=circumstances.warm_up_min,
        probe=circumstances.probe,
        probe_diameter_mm=2.0 * _tip_mm(measured, arm),
        probe_length_mm=float(np.linalg.norm(arm.probe.vector_mm)),
        arm_name=arm.name,
        arm_serial_number=arm.serial_number,
        arm_calibration_date=str(identified) if identified else None,
        measuring_range_mm=limits.measuring_range_mm,
        reach_mm=measured[0].reach_mm,
        next_date=_day(limits.next_date),
        standards=standards_used(touched),
        tools=tools or None,
        longest_mm=max(_lengths_mm(touched.values()), default=None),
        too_large_limits=tuple(_too_large(limits, measured[0].reach_mm)) or None,
        agreement=limits.agreement,
        copied_touches=copied_touches(
            of for each in measured for of in each.touched.values()
        ),
        is_of_identification=_is_of_identification(arm, occasion.campaign_digest),
    )


def _lengths_mm(artefacts: Iterable[Artefact]) -> Iterator[float]:
    for artefact in artefacts:
        with suppress(IncompleteError):  # a sphere, a cone
            yield certified_length(artefact)[0]


def _too_large(limits: Limits, reach_mm: float) -> Iterator[str]:
    for name in Mpe.model_fields:
        limit = limits.mpe.of(name.removesuffix("_mm"))
        if limit is not None and limit.at(reach_mm) > FARTHEST * reach_mm:
            yield f"{name} = {limit.at(reach_mm):g}"


def _tip_mm(measured: Sequence[Measurement], arm: Arm) -> float:
    """Return the radius of the tip of all touches, where they have one."""
    tips_mm = {
        float(tip_mm)
        for each in measured
        for touched in each.touched.values()
        for tip_mm in np.unique(touched.tip_mm)
    }
    return tips_mm.pop() if len(tips_mm) == 1 else arm.probe.radius_mm


def _is_of_identification(arm: Arm, digest: str | None) -> bool | None:
    known = arm.identification and arm.identification.campaign_digest
    return True if known and known == digest else None


def standards_used(artefacts: Mapping[str, Artefact]) -> tuple[StandardUsed, ...]:
    """Name each calibrated standard once; twice where its certificates differ."""
    standards: dict[tuple[StandardUsed, float | None], list[str]] = {}
    for name, artefact in artefacts.items():
        material = None
        if isinstance(artefact, ExpandingArtefact):
            material = artefact.material
        elif not (isinstance(artefact, Plane) and artefact.form_mm is not None):
            continue  # not calibrated
        expansion = artefact.stated_expansion
        used = StandardUsed(
            artefact.kind,
            (),
            artefact.serial_number,
            _day(artefact.calibration_date),
            artefact.certificate_number,
            artefact.calibrated_by,
            _day(artefact.valid_until),
            material,
            expansion.per_c,
            expansion.std_per_c,
        )
        radius_mm = artefact.radius_mm if isinstance(artefact, Sphere) else None
        standards.setdefault((used, radius_mm), []).append(name)
    return tuple(
        replace(used, artefacts=tuple(names)) for (used, _), names in standards.items()
    )


def _day(day: date | None) -> str | None:
    return None if day is None else day.isoformat()

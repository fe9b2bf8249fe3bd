"""Statements that a verdict rests on, and which of them are absent.

One table for all standards. What a certificate states is ISO/IEC 17025:2017, 7.8.2 and
7.8.4 (read in published descriptions); which circumstances a test by each standard is
reported with is general knowledge.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.acceptance.administration import (
    Administration,
    StandardUsed,
    administration_of,
)
from traverse.lab.acceptance.limits import Limits
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.measured_points.measurement import Measurement, reach_of
from traverse.lab.measured_points.reading import occasion_of
from traverse.lab.outcomes.acceptance import AbsentStatement

# Standards whose test is an interim check, which certifies nothing.
INTERIM = ("vdi2617-9",)
SCANNING = ("iso10360-8",)

Lacking = Callable[[Administration], Iterable[str]]


@dataclass(frozen=True, slots=True)
class Statement:
    """A row of the table.

    Attributes:
        code: Its name in JSON.
        text: What is to be stated, without an article.
        where: Key and file.
        lacking: Of what it is absent: names of standards, or "" for the measurement.
        without: Standards that do not require it.
    """

    code: str
    text: str
    where: str
    lacking: Lacking
    without: tuple[str, ...] = ()


def _absent(key: str) -> Lacking:
    def lacking(stated: Administration) -> Iterator[str]:
        if getattr(stated, key) in (None, ""):
            yield ""

    return lacking


def _of_standards(key: str) -> Lacking:
    def lacking(stated: Administration) -> Iterator[str]:
        for standard in stated.standards:
            if getattr(standard, key) in (None, ""):
                yield standard.name

    return lacking


def _expanding(key: str) -> Lacking:
    """As `_of_standards`, without flats: their form does not depend on the warmth."""

    def lacking(stated: Administration) -> Iterator[str]:
        standards = tuple(each for each in stated.standards if each.kind != "plane")
        yield from _of_standards(key)(replace(stated, standards=standards))

    return lacking


def _invalid(stated: Administration) -> Iterator[str]:
    """Name standards whose certificate did not hold on a day of the measurement."""
    first, last = stated.measured_from_utc, stated.measured_to_utc
    if first is None or last is None:
        return
    days = first[:10], last[:10]
    yield from (each.name for each in stated.standards if not _holds(each, *days))


def _holds(standard: StandardUsed, first: str, last: str) -> bool:
    begun = standard.calibration_date is None or standard.calibration_date <= first
    return begun and (standard.valid_until is None or last <= standard.valid_until)


def _coefficient_alone(stated: Administration) -> Iterator[str]:
    for standard in stated.standards:
        if (
            standard.expansion_per_c is not None
            and standard.expansion_std_per_c is None
        ):
            yield standard.name


def _copied(stated: Administration) -> Iterator[str]:
    if stated.copied_touches is not None:
        yield f"{stated.copied_touches} touches"


def _identified(stated: Administration) -> Iterator[str]:
    if stated.is_of_identification:
        yield ""


_CAMPAIGN = "of campaign.toml"
_STANDARDS = f"in [[artefacts]] {_CAMPAIGN}"
_CIRCUMSTANCES = f"in [circumstances] {_CAMPAIGN}"
STATEMENTS = (
    Statement(
        "arm_serial_number",
        "serial number of the arm",
        "serial_number of arm.toml",
        _absent("arm_serial_number"),
    ),
    Statement(
        "probe",
        "type and serial number of the probe",
        f"probe {_CIRCUMSTANCES}",
        _absent("probe"),
    ),
    Statement("operator", "operator", f"operator {_CAMPAIGN}", _absent("operator")),
    Statement("place", "place", f"place {_CAMPAIGN}", _absent("place")),
    Statement(
        "dates",
        "date of the measurement",
        f"start_utc {_CAMPAIGN}, or time_ns of exported points",
        _absent("measured_from_utc"),
    ),
    Statement(
        "touches",
        "place of their own, which copies have not,",
        "leave the place before each touch, delete copies",
        _copied,
    ),
    Statement(
        "independence",
        "measurement that the arm was not identified from",
        "touch again; [identification] of arm.toml names this campaign",
        _identified,
    ),
    Statement(
        "temperature",
        "temperature",
        "column temperature_c of the poses",
        _absent("temperature_mean_c"),
    ),
    Statement(
        "humidity",
        "humidity of the air",
        f"humidity_percent {_CIRCUMSTANCES}",
        _absent("humidity_percent"),
        without=INTERIM,
    ),
    Statement(
        "warm_up",
        "time of warming up",
        f"warm_up_min {_CIRCUMSTANCES}",
        _absent("warm_up_min"),
        without=INTERIM,
    ),
    Statement(
        "measuring_range",
        "measuring range",
        "measuring_range_mm of limits.toml",
        _absent("measuring_range_mm"),
        without=(*INTERIM, *SCANNING),
    ),
    Statement(
        "agreement",
        "agreement to apply the standard to an arm",
        "agreement of limits.toml",
        _absent("agreement"),
        without=("iso10360-12", "asme-b89.4.22", *INTERIM),
    ),
    Statement(
        "standard_serial_number",
        "serial number",
        f"serial_number {_STANDARDS}",
        _of_standards("serial_number"),
    ),
    Statement(
        "certificate_number",
        "number of the certificate",
        f"certificate_number {_STANDARDS}",
        _of_standards("certificate_number"),
    ),
    Statement(
        "calibration_date",
        "date of calibration",
        f"calibration_date {_STANDARDS}",
        _of_standards("calibration_date"),
    ),
    Statement(
        "calibrated_by",
        "laboratory of the calibration",
        f"calibrated_by {_STANDARDS}",
        _of_standards("calibrated_by"),
    ),
    Statement(
        "valid_until",
        "last day of validity",
        f"valid_until {_STANDARDS}",
        _of_standards("valid_until"),
    ),
    Statement(
        "certificate_holds",
        "certificate that holds on the day of the measurement",
        f"calibration_date and valid_until {_STANDARDS}, or have it calibrated",
        _invalid,
    ),
    Statement(
        "expansion",
        "coefficient of expansion",
        f"material, or expansion_per_c, {_STANDARDS}",
        _expanding("expansion_per_c"),
    ),
    Statement(
        "expansion_std",
        "uncertainty of the coefficient of expansion",
        f"expansion_std_per_c, or material alone, {_STANDARDS}",
        _coefficient_alone,
    ),
)


def required_statements(standard: str) -> tuple[Statement, ...]:
    """List what a verdict by a standard rests on."""
    return tuple(
        statement for statement in STATEMENTS if standard not in statement.without
    )


def absent_statements(
    standard: str, stated: Administration
) -> tuple[AbsentStatement, ...]:
    """List what is missing for a verdict by a standard, each with where to state it."""
    return tuple(
        AbsentStatement(statement.code, statement.text, statement.where, names)
        for statement in required_statements(standard)
        if (names := tuple(statement.lacking(stated)))
    )


def absent_before(
    standard: str, file: CampaignFile, arm: Arm, limits: Limits
) -> tuple[AbsentStatement, ...]:
    """List what is missing for a verdict while nothing has been touched yet.

    What only touches can state, their temperature, is left out.
    """
    occasion = occasion_of(file, ())
    shoulder_mm, reach_mm = reach_of(arm)
    nothing = Measurement(
        {artefact.id: artefact for artefact in file.artefacts},
        {},
        arm.name,
        shoulder_mm,
        reach_mm,
        occasion=replace(occasion, first_utc=file.start_utc, last_utc=file.start_utc),
    )
    absent = absent_statements(standard, administration_of([nothing], arm, limits))
    return tuple(entry for entry in absent if entry.code != "temperature")

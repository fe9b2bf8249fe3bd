"""Statements that a verdict rests on, and which of them are absent.

One table for all standards. What a certificate states is ISO/IEC 17025:2017, 7.8.2 and
7.8.4 (read in published descriptions); which circumstances a test by each standard is
reported with is general knowledge.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.acceptance.administration import (
    Administration,
    StandardUsed,
    administration_of,
)
from traverse.lab.acceptance.laboratory import says_nothing
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.procedures.belonging import FARTHEST
from traverse.lab.acceptance.procedures.length_tests import LEAST_SHARE
from traverse.lab.artefacts.materials import MATERIALS, TABLE_HOLDS_C, Expansion
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.measured_points.measurement import Measurement, reach_of
from traverse.lab.measured_points.reading import occasion_of
from traverse.lab.outcomes.acceptance import AbsentStatement
from traverse.lab.report.provenance import utc_text

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


# Where a value is not called as its statement is.
_KEYS = {
    "dates": "measured_from_utc",
    "temperature": "temperature_mean_c",
    "humidity": "humidity_percent",
    "warm_up": "warm_up_min",
    "measuring_range": "measuring_range_mm",
    "standard_serial_number": "serial_number",
}


def _of_measurement(
    code: str, text: str, where: str, without: tuple[str, ...] = ()
) -> Statement:
    key = _KEYS.get(code, code)

    def lacking(stated: Administration) -> Iterator[str]:
        if says_nothing(getattr(stated, key)):
            yield ""

    return Statement(code, text, where, lacking, without)


def _standards(is_lacking: Callable[[StandardUsed], bool]) -> Lacking:
    """Name the standards that lack something."""
    return lambda stated: (each.name for each in stated.standards if is_lacking(each))


def _of_standards(code: str, text: str) -> Statement:
    key = _KEYS.get(code, code)
    lacking = _standards(lambda each: says_nothing(getattr(each, key)))
    return Statement(code, text, f"{key} {_STANDARDS}", lacking)


def _invalid(stated: Administration) -> Iterable[str]:
    """Name standards whose certificate did not hold on a day of the measurement."""
    first, last = stated.measured_from_utc, stated.measured_to_utc
    if first is None or last is None:
        return ()
    first, last = first[:10], last[:10]
    return _standards(
        lambda each: (
            (each.calibration_date or first) > first
            or (each.valid_until or last) < last
        )
    )(stated)


def _contradicted(stated: Administration) -> Iterator[str]:
    """Name standards of one serial number that different certificates are stated of."""
    named = Counter(each.name for each in stated.standards if each.serial_number)
    yield from (name for name, times in named.items() if times > 1)


def _beyond_the_table(stated: Administration) -> Iterable[str]:
    """Name standards whose coefficient is that of the table, and does not hold."""
    least_c, most_c = stated.temperature_least_c, stated.temperature_largest_c
    if least_c is None or most_c is None:
        return ()
    if TABLE_HOLDS_C[0] <= least_c and most_c <= TABLE_HOLDS_C[1]:
        return ()
    return _standards(
        lambda each: (
            each.material is not None
            and MATERIALS[each.material]
            == Expansion(each.expansion_per_c, each.expansion_std_per_c)
        )
    )(stated)


def _out_of_range(stated: Administration) -> Iterator[str]:
    longest_mm, range_mm = stated.longest_mm, stated.measuring_range_mm
    if longest_mm is None or range_mm is None:
        return
    if not LEAST_SHARE * range_mm <= longest_mm <= range_mm:
        yield f"{longest_mm:.0f} mm of {range_mm:g} mm"


def _passed(stated: Administration) -> Iterator[str]:
    """Say so where the next test is not after this one."""
    next_date, last = stated.next_date, stated.measured_to_utc
    if next_date is not None and last is not None and next_date <= last[:10]:
        yield next_date


_CAMPAIGN = "of campaign.toml"
_STANDARDS = f"in [[artefacts]] {_CAMPAIGN}"
_CIRCUMSTANCES = f"in [circumstances] {_CAMPAIGN}"
_TIMES = f"start_utc {_CAMPAIGN}, or time_ns of points; not in the future"
_BEYOND_ISO_12 = ("asme-b89.4.22", *INTERIM, *SCANNING)
STATEMENTS = (
    _of_measurement(
        "arm_serial_number", "serial number of the arm", "serial_number of arm.toml"
    ),
    _of_measurement(
        "probe", "type and serial number of the probe", f"probe {_CIRCUMSTANCES}"
    ),
    _of_measurement("operator", "operator", f"operator {_CAMPAIGN}"),
    _of_measurement("place", "place", f"place {_CAMPAIGN}"),
    _of_measurement("dates", "date of the measurement", _TIMES),
    Statement(
        "touches",
        "place of their own, which copies have not,",
        "leave the place before each touch, delete copies",
        lambda stated: (
            [f"{stated.copied_touches} touches"] if stated.copied_touches else ()
        ),
    ),
    Statement(
        "independence",
        "measurement that the arm was not identified from",
        "touch again; [identification] of arm.toml names this campaign",
        lambda stated: [""] if stated.is_of_identification else (),
    ),
    _of_measurement("temperature", "temperature", "column temperature_c of the poses"),
    _of_measurement(
        "humidity", "humidity", f"humidity_percent {_CIRCUMSTANCES}", INTERIM
    ),
    _of_measurement(
        "warm_up", "time of warming up", f"warm_up_min {_CIRCUMSTANCES}", INTERIM
    ),
    _of_measurement(
        "measuring_range",
        "measuring range",
        "measuring_range_mm of limits.toml",
        (*INTERIM, *SCANNING),
    ),
    Statement(
        "longest_length",
        f"longest length of {LEAST_SHARE:.0%} to 100% of the measuring range instead",
        "measuring_range_mm of limits.toml, or measure longer lengths",
        _out_of_range,
        ("asme-b89.4.22", *INTERIM, *SCANNING),
    ),
    _of_measurement(
        "agreement",
        "agreement to apply the standard to an arm",
        "agreement of limits.toml",
        ("iso10360-12", "asme-b89.4.22", *INTERIM),
    ),
    Statement(
        "limits",
        f"permissible error in mm, below {FARTHEST:.0%} of the reach, instead",
        "[mpe] of limits.toml",
        lambda stated: stated.too_large_limits or (),
    ),
    Statement(
        "next_date",
        "next test that is after this one instead",
        "next_date of limits.toml",
        _passed,
    ),
    _of_standards("standard_serial_number", "serial number"),
    _of_standards("certificate_number", "number of the certificate"),
    _of_standards("calibration_date", "date of calibration"),
    _of_standards("calibrated_by", "laboratory of the calibration"),
    _of_standards("valid_until", "last day of validity"),
    Statement(
        "certificate_holds",
        "certificate that holds on the day of the measurement",
        f"calibration_date and valid_until {_STANDARDS}, or have it calibrated",
        _invalid,
    ),
    Statement(
        "one_certificate",
        "one and the same certificate",
        f"serial_number, or what its certificate states, {_STANDARDS}",
        _contradicted,
    ),
    Statement(
        "expansion",
        "coefficient of expansion",
        f"material, or expansion_per_c, {_STANDARDS}",
        # The form of a flat does not depend on the warmth.
        _standards(lambda each: each.kind != "plane" and each.expansion_per_c is None),
    ),
    Statement(
        "expansion_std",
        "uncertainty of the coefficient of expansion",
        f"expansion_std_per_c, or material alone, {_STANDARDS}",
        _standards(
            lambda each: (
                each.expansion_per_c is not None and not each.expansion_std_per_c
            )
        ),
    ),
    Statement(
        "expansion_holds",
        "coefficient that holds beyond {:g} to {:g} °C".format(*TABLE_HOLDS_C),
        f"expansion_per_c and expansion_std_per_c of its certificate {_STANDARDS}",
        _beyond_the_table,
    ),
)


def required_statements(standard: str) -> tuple[Statement, ...]:
    """List what a verdict by a standard rests on."""
    return tuple(
        statement for statement in STATEMENTS if standard not in statement.without
    )


def absent_statements(
    standard: str, stated: Administration, computed_utc: str
) -> tuple[AbsentStatement, ...]:
    """List what is missing for a verdict by a standard, each with where to state it.

    Times are ISO 8601 with Z.
    """
    if (stated.measured_to_utc or "")[:10] > computed_utc[:10]:
        stated = replace(stated, measured_from_utc=None)
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
        shoulder_mm,
        reach_mm,
        occasion=replace(occasion, first_utc=file.start_utc, last_utc=file.start_utc),
    )
    stated = administration_of([nothing], arm, limits)
    absent = absent_statements(standard, stated, utc_text(datetime.now(UTC)))
    return tuple(entry for entry in absent if entry.code != "temperature")

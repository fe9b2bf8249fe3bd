"""Report of a history of daily checks: charts, warnings, the last acceptance beside."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from traverse.lab.acceptance.certificate.digests import read_values
from traverse.lab.acceptance.limits import NO_LIMITS, Limits
from traverse.lab.daily_check.control_chart import (
    ChartPoint,
    Rule,
    charted,
    drift_per_check,
    rules,
)
from traverse.lab.daily_check.figures import KINDS, MOST_U, FigureKind
from traverse.lab.daily_check.history import Check, since_base
from traverse.lab.measured_points.reading import OWN_PROBE
from traverse.lab.outcomes.base import Outcome, State
from traverse.lab.outcomes.daily_check import WORDS as VERDICTS
from traverse.lab.outcomes.daily_check import (
    DailyCheckEvidence,
    JudgedFigure,
    daily_check_outcome,
)
from traverse.lab.report.provenance import ReportSource, report_provenance
from traverse.lab.report.quantities import picked, plain_values
from traverse.lab.report.templates import Words
from traverse.strict_toml.problems import FileError

SCHEMA = "traverse/interim/1"
WORDS = Words("daily_check/words.jinja")
# From check to check: more is another room, or another unit.
_OTHER_C = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class FigureChart:
    """The chart of one figure since the base began.

    Beside it what is permitted, and what the last acceptance found, where known.
    """

    kind: FigureKind
    points: tuple[ChartPoint, ...]
    limit_mm: float | None
    accepted_mm: float | None
    stated_mm: float | None

    @property
    def last(self) -> ChartPoint:
        return self.points[-1]

    @property
    def rules(self) -> tuple[Rule, Rule, Rule]:
        return rules("above" if self.kind.positive else "both")

    @property
    def most_mm(self) -> float:
        """Permissible error, else what the arm states of itself: beyond is no base.

        An error is assumed only of an arm that states nothing.
        """
        if self.limit_mm is not None:
            return self.limit_mm
        if self.stated_mm is not None:
            return MOST_U * self.stated_mm
        return self.kind.assumed_mm

    @property
    def judged(self) -> JudgedFigure:
        """The last check's, as the conditions look at it."""
        last = self.last
        # What else was touched once is no drift.
        values_mm = [point.value for point in self.points]
        possible_mm = [value for value in values_mm if abs(value) <= self.most_mm]
        width_mm = None
        if last.high is not None and last.centre is not None:
            width_mm = last.high - last.centre
        return JudgedFigure(
            name=self.kind.name,
            value_mm=last.value,
            permissible_mm=self.most_mm,
            is_stated=self.limit_mm is not None,
            is_of_arm=self.stated_mm is not None,
            plausible_mm=self.kind.plausible_mm,
            half_width_mm=width_mm,
            alarms=last.alarms,
            drift_mm=drift_per_check(possible_mm, positive=self.kind.positive),
        )


@dataclass(frozen=True, slots=True, eq=False)
class DailyCheckReport:
    """All charts, judged at the last check.

    Attributes:
        checks: Since the base began.
        charts: In the order of `KINDS`.
        acceptance: Date and standard of the certificate compared with, or None.
        changes: What is not as at the check before, each with its remedy.
    """

    checks: tuple[Check, ...]
    charts: tuple[FigureChart, ...]
    acceptance: str | None
    changes: tuple[tuple[str, str], ...]

    @property
    def outcome(self) -> Outcome:
        figures = [chart.judged for chart in self.charts]
        return daily_check_outcome(
            DailyCheckEvidence(figures, len(self.checks), self.changes)
        )

    @property
    def word(self) -> str:
        return VERDICTS[self.outcome.state]

    @property
    def false_alarms(self) -> float:
        """Of all rules together, a check, if they never coincided."""
        return sum(rule.rate for chart in self.charts for rule in chart.rules)


def report_of(
    checks: Sequence[Check],
    limits: Limits = NO_LIMITS,
    certificate: Mapping[str, Any] | None = None,
) -> DailyCheckReport:
    """Judge the last of some checks of an arm.

    There is at least one check, and all of its history; the certificate is that of the
    last acceptance.
    """
    counted = since_base(list(checks))
    figures = (certificate or {}).get("figures", ())
    accepted = {f["key"]: f for f in figures if f.get("tool") in (None, OWN_PROBE)}
    charts = []
    for kind in KINDS:
        values = [float(getattr(check.figures, kind.key)) for check in counted]
        beside = accepted.get(kind.like, {})
        limit = limits.mpe.of(kind.like)
        limit_mm = beside.get("limit_mm") if limit is None else limit.constant_mm
        chart = FigureChart(
            kind,
            (),
            limit_mm,
            beside.get("value_mm"),
            counted[-1].figures.stated_mm,
        )
        points = charted(values, positive=kind.positive, most=chart.most_mm)
        charts.append(replace(chart, points=tuple(points)))
    compared = None
    if certificate is not None:
        compared = f"{certificate['standard']} of {certificate['date_utc']}"
    changes = tuple(_changes(counted, certificate))
    return DailyCheckReport(tuple(counted), tuple(charts), compared, changes)


def _changes(
    checks: Sequence[Check], certificate: Mapping[str, Any] | None
) -> Iterator[tuple[str, str]]:
    """Say what is not as at the check before, with the remedy."""
    last = checks[-1]
    touches = {(check.figures.n_cone, check.figures.n_sphere) for check in checks}
    if len(checks) > 1:
        before = checks[-2]
        if last.arm_digest != before.arm_digest:
            yield (
                "The arm file is another than at the check before.",
                "After an identification or a repair begin a new base with --new-base.",
            )
        if last.figures.sphere_radius_mm != before.figures.sphere_radius_mm:
            yield (
                "The sphere is another than at the check before: its radius is "
                f"{last.figures.sphere_radius_mm:g} mm instead of "
                f"{before.figures.sphere_radius_mm:g} mm.",
                "See whether its calibrated radius is right.",
            )
        now_c, then_c = last.figures.temperature_c, before.figures.temperature_c
        if now_c is not None and then_c is not None and abs(now_c - then_c) > _OTHER_C:
            yield (
                f"It is {now_c:.1f} °C instead of {then_c:.1f} °C at the check before.",
                "See whether the temperature is right, in °C; wait until arm and "
                "sphere have that of the room.",
            )
    if len(touches) > 1:
        yield (
            "Numbers of touches differ between checks: ranges and largest values grow "
            "with them.",
            "Touch equally often each time.",
        )
    if certificate and certificate["arm"]["digest"] != last.arm_digest:
        yield (
            "The last acceptance was of another arm file.",
            "Verify the arm as it is.",
        )


def read_certificate(path: Path, arm: str) -> dict[str, Any]:
    """Read `certificate.json` of the last acceptance.

    Raises:
        FileError: It is none, or of another arm.
    """
    values = read_values(path)
    stated = values.get("arm")
    name = stated.get("name") if isinstance(stated, dict) else None
    if name != arm:
        raise FileError(path, f"is of arm {name!r}, expected {arm!r}")
    return values


def report_values(report: DailyCheckReport) -> dict[str, Any]:
    check, outcome = report.checks[-1], report.outcome
    return {
        "schema": SCHEMA,
        "time_utc": check.time_utc,
        "arm": {"name": check.arm, "digest": check.arm_digest},
        "checks": len(report.checks),
        **plain_values(outcome),
        "in_control": outcome.state is State.GOOD,
        "provenance": report_provenance(
            ReportSource("daily check", check.data_digest)
        ).values,
        "acceptance": report.acceptance,
        "false_alarms_per_check": report.false_alarms,
        "figures": [_values(chart) for chart in report.charts],
    }


def _values(chart: FigureChart) -> dict[str, Any]:
    last = chart.last
    return {
        **picked(chart.kind, "key", "name", "definition"),
        **picked(last, value_mm="value", centre_mm="centre", low_mm="low"),
        **picked(last, "q", "moving_range", "ewma", "alarms", high_mm="high"),
        **picked(chart, "limit_mm", "accepted_mm", permissible_mm="most_mm"),
        "expanded_uncertainty_mm": chart.stated_mm,
        "exceeds_limit": chart.judged.exceeds,
        "rules": [
            {"name": rule.name, "false_alarms_per_check": rule.rate}
            for rule in chart.rules
        ],
    }

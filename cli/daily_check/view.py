"""A daily check in lines of text: figures, charts, warnings."""

from collections.abc import Iterator

from traverse.lab.daily_check.chart_pictures import chart_lines
from traverse.lab.daily_check.control_chart import rules
from traverse.lab.daily_check.report import DailyCheckReport, FigureChart
from traverse.plurals import counted

CHECKS_A_YEAR = 250


def report_lines(report: DailyCheckReport) -> Iterator[str]:
    """Print a report."""
    check = report.checks[-1]
    warm = check.figures.temperature_c
    yield (
        f"{check.arm}, {check.time_utc}, "
        f"{counted(len(report.checks), 'check')} since the base began"
        + ("" if warm is None else f", {warm:.1f} C")
    )
    if report.acceptance is not None:
        yield f"beside the acceptance {report.acceptance}"
    for chart in report.charts:
        yield ""
        yield _figure(chart)
        yield f"  {chart.kind.definition}"
        if chart.last.q is not None:
            yield from chart_lines(chart)
        for name in chart.last.alarms:
            yield f"  WARNING: {name}"
        if chart.exceeds:
            what = "plausible" if chart.limit_mm is None else "permitted"
            yield f"  WARNING: beyond the {what} {1000 * chart.most_mm:.1f} um"
    yield ""
    yield from report.remarks
    rates = ", ".join(f"{rule.name} {rule.rate:.3%}" for rule in rules("both"))
    yield (
        f"false alarms a check where nothing changes: {rates} (half of each where only "
        f"values above count); all together {report.false_alarms:.2%} at most, "
        f"{CHECKS_A_YEAR * report.false_alarms:.1f} in {CHECKS_A_YEAR} checks"
    )
    yield report.word


def _figure(chart: FigureChart) -> str:
    last = chart.last
    text = f"{chart.kind.name}: {1000 * last.value:.1f} um"
    if last.centre is not None and last.high is not None:
        low = "" if last.low is None else f"{1000 * last.low:.1f} to "
        text += (
            f"; expected {1000 * last.centre:.1f}, limit {low}{1000 * last.high:.1f}"
        )
    if chart.accepted_mm is not None:
        text += f"; at acceptance {1000 * chart.accepted_mm:.1f}"
    return text

"""A daily check in lines of text: figures, charts, warnings."""

from collections.abc import Iterator

from traverse.lab.daily_check.chart_pictures import chart_lines
from traverse.lab.daily_check.control_chart import rules
from traverse.lab.daily_check.report import WORDS, DailyCheckReport

CHECKS_A_YEAR = 250


def report_lines(report: DailyCheckReport) -> Iterator[str]:
    """Print a report."""
    yield from WORDS.lines("head", report)
    for chart in report.charts:
        yield ""
        yield from WORDS.lines("figure", chart)
        if chart.last.q is not None:
            yield from chart_lines(chart)
        yield from WORDS.lines("warnings", chart)
    yield ""
    yield from report.remarks
    yield WORDS.false_alarms(report, rules("both"), CHECKS_A_YEAR)
    yield report.word

"""Control charts: pictures in PNG and HTML, and a check in lines for a terminal."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Integers
from traverse.lab.daily_check.control_chart import EWMA_LIMIT, ChartPoint, rules
from traverse.lab.daily_check.report import WORDS, DailyCheckReport, FigureChart
from traverse.lab.report.figures import BLUE, GREY, ORANGE, VERMILION, picture
from traverse.lab.report.provenance import ReportSource, report_provenance
from traverse.lab.report.templates import page
from traverse.strict_toml.writing import write_atomically

ROWS = 9
SHOWN = 60
CHECKS_A_YEAR = 250
_UM = 1000.0


def chart_png(report: DailyCheckReport) -> bytes:
    """All charts as a picture: values with limits, moving ranges, weighted means."""
    height_mm = 66.0 * len(report.charts)
    return picture(280.0, height_mm, _paint_charts, report)


def _paint_charts(figure: Figure, report: DailyCheckReport) -> None:
    axes = figure.subplots(len(report.charts), 3, squeeze=False, width_ratios=[2, 1, 1])
    for row, chart in zip(axes, report.charts, strict=True):
        numbers = np.arange(1, len(chart.points) + 1)
        _paint_values(row[0], chart, numbers)
        ranges = [p.moving_range for p in chart.points]
        _paint(row[1], numbers, ranges, chart.points)
        row[1].set_title("moving range / sigma")
        weighted = [p.ewma if p.q is not None else None for p in chart.points]
        _paint(row[2], numbers, weighted, chart.points)
        row[2].axhline(EWMA_LIMIT, color=VERMILION, linewidth=0.8)
        if not chart.kind.positive:
            row[2].axhline(-EWMA_LIMIT, color=VERMILION, linewidth=0.8)
        row[2].set_title("EWMA / sigma")
    for cell in axes[-1]:
        cell.set_xlabel("check")


def write_charts(report: DailyCheckReport, folder: Path) -> list[str]:
    folder.mkdir(parents=True, exist_ok=True)
    png = chart_png(report)
    (folder / "chart.png").write_bytes(png)
    check = report.checks[-1]
    provenance = report_provenance(ReportSource("daily check", check.data_digest))
    text = page(
        "daily_check/chart.jinja", {}, report=report, picture=png, provenance=provenance
    )
    write_atomically(folder / "chart.html", text)
    return ["chart.png", "chart.html"]


def chart_lines(chart: FigureChart) -> list[str]:
    """The last checks of a figure as characters, a column a check.

    `o` is a check, `X` one that broke a rule; `-` are the limits and `.` is the middle
    of the last one.
    """
    points = chart.points[-SHOWN:]
    last = chart.last
    marks_um = [_UM * x for x in (last.centre, last.low, last.high) if x is not None]
    values_um = [_UM * p.value for p in points]
    low, high = min(values_um + marks_um), max(values_um + marks_um)
    step = (high - low) / (ROWS - 1) or 1.0

    def row_of(um: float) -> int:
        return round((high - um) / step)

    grid = [[" "] * len(points) for _ in range(ROWS)]
    for mark, sign in ((last.low, "-"), (last.high, "-"), (last.centre, ".")):
        if mark is not None:
            grid[row_of(_UM * mark)] = [sign] * len(points)
    for column, (point, um) in enumerate(zip(points, values_um, strict=True)):
        grid[row_of(um)][column] = "X" if point.alarms else "o"
    return [
        f"{high - row * step:9.1f} |{''.join(cells)}|" for row, cells in enumerate(grid)
    ]


def report_lines(report: DailyCheckReport) -> Iterator[str]:
    """Describe a check in lines: figures, charts, warnings."""
    yield from WORDS.lines("head", report)
    for chart in report.charts:
        yield ""
        yield from WORDS.lines("figure", chart)
        if chart.last.q is not None:
            yield from chart_lines(chart)
    yield ""
    yield from report.outcome.sentences
    yield WORDS.false_alarms(report, rules("both"), CHECKS_A_YEAR)
    yield report.word


def _paint_values(cell: Axes, chart: FigureChart, numbers: Integers) -> None:
    points = chart.points
    values = [_UM * p.value for p in points]
    _paint(cell, numbers, values, points)
    for name, style in (("centre", "-"), ("low", "--"), ("high", "--")):
        ends_mm = np.array([getattr(p, name) for p in points], dtype=float)
        cell.plot(numbers, ends_mm * _UM, style, color=BLUE, linewidth=0.8)
    if chart.limit_mm is not None:
        cell.axhline(_UM * chart.limit_mm, color=VERMILION, linewidth=1.0)
    if chart.accepted_mm is not None:
        cell.axhline(_UM * chart.accepted_mm, color=ORANGE, linestyle=":")
    # Limits of the first checks are very wide.
    span = max(values) - min(values) or 1.0
    ends = [_UM * x for x in (points[-1].low, points[-1].high) if x is not None]
    cell.set_ylim(
        min([*values, *ends]) - 0.1 * span, max([*values, *ends]) + 0.1 * span
    )
    cell.set_title(f"{chart.kind.name} [um]")


def _paint(
    cell: Axes,
    numbers: Integers,
    values: Sequence[float | None],
    points: tuple[ChartPoint, ...],
) -> None:
    """Draw values, and mark those that broke a rule."""
    shown = np.array(values, dtype=float)
    cell.plot(numbers, shown, color=GREY, linewidth=0.8)
    colours = [VERMILION if p.alarms else BLUE for p in points]
    cell.scatter(numbers, shown, c=colours, s=9, zorder=3)

"""The report of an inspection: a sheet to print, a table, and JSON."""

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from html import escape
from pathlib import Path

from traverse.client.inspection.values import (
    FeatureResult,
    FigureResult,
    Inspection,
    TouchResult,
)
from traverse.plurals import counted
from traverse.protocol.printable import printable, spreadsheet_cell
from traverse.strict_toml.files import text_of

COLUMNS = (
    *("part", "serial", "feature", "kind", "of", "figure", "unit", "value", "U"),
    *("nominal", "lower", "upper", "conformity", "touches", "problem"),
)
"""Columns of the table: a row for each figure, or for a feature without."""
DEFINITIONS = (
    "Elements are of least squares, through the touched surface: centres of the ball "
    "compensated by its radius on the side that was touched.",
    "Samples of a scan are thinned, and count as often as they are independent.",
    "U is the expanded uncertainty, k = 2: of encoders, contacts and the arm's "
    "identified parameters, which all touches share, and of what the fits found beyond "
    "that; of the ball's radius and the part's temperature, where they are stated. "
    "Lengths are those at 20 °C, where the part's temperature is stated.",
    "Conformity by ISO 14253-1: proved where the value keeps U from its limits; not "
    "conforming where it is outside by more than U; undecided between. Figures without "
    "U, or whose U leaves something out, or with touches in doubt, are not judged.",
    "Form is the largest less the smallest distance of the touches; it has the arm's "
    "own scatter in it.",
)
_STYLE = text_of(Path(__file__).with_name("sheet.css"))
_CLASSES = {"conforming": "good", "not conforming": "bad"}


def json_text(inspection: Inspection) -> str:
    values = {"schema": "traverse/inspection/1", **asdict(inspection)}
    return json.dumps(values, indent=1, allow_nan=False) + "\n"


def csv_text(inspection: Inspection) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for feature in inspection.features:
        about = [inspection.part, inspection.serial, feature.name, feature.kind]
        cells = [spreadsheet_cell(name) for name in (*about, " ".join(feature.of))]
        trailing_cells = [len(feature.touches) or None, feature.problem]
        for figure in feature.figures or (None,):
            writer.writerow([*cells, *_figure_cells(figure), *trailing_cells])
    return text.getvalue()


def _figure_cells(figure: FigureResult | None) -> list[object]:
    if figure is None:
        return [None] * 8
    return [
        *(figure.name, figure.unit, figure.value, figure.expanded),
        *(figure.nominal, figure.lower, figure.upper, figure.conformity),
    ]


def summary_lines(inspection: Inspection) -> list[str]:
    lines = []
    for feature in inspection.features:
        title = f"{feature.name} ({feature.kind})"
        if feature.problem:
            lines.append(f"{title}: {feature.problem}")
        for figure in feature.figures:
            words = " ".join(figure_words(figure))
            lines.append(f"{title}: {figure.name} {words}")
    if inspection.uncertainty_unknown:
        lines.append(f"no uncertainty: {inspection.uncertainty_unknown}")
    else:
        lines += inspection.left_out
    if inspection.conformity is not None:
        lines.append(f"part: {inspection.conformity}")
    return [printable(line) for line in lines]


def figure_words(figure: FigureResult) -> tuple[str, str, str]:
    """Return value with unit, uncertainty, and tolerance with decision."""
    unit = "°" if figure.unit == "deg" else " mm"
    value = f"{figure.value:.4f}{unit}"
    expanded = "" if figure.expanded is None else f"± {figure.expanded:.4f}"
    if figure.nominal is None:
        return value, expanded, ""
    limits = f"[{figure.nominal:g} {figure.lower:+g} {figure.upper:+g}]"
    return value, expanded, f"{limits} {figure.conformity}"


def sheet_html(inspection: Inspection, logo: str = "") -> str:
    """Make the sheet; `logo` is a data URI, see `logo_uri`."""
    now = datetime.now(UTC)
    verdict = inspection.conformity or "no tolerances"
    title = f"Inspection of {inspection.part or 'a part'}"
    measured = datetime.fromtimestamp(inspection.last_ns / 1e9, UTC)
    about = [
        ("Part", inspection.part),
        ("Serial number", inspection.serial),
        ("Operator", inspection.operator),
        ("Measured", f"{measured:%Y-%m-%d %H:%M} UTC" if inspection.last_ns else ""),
        ("Arm", inspection.arm),
        ("Arm's identification", inspection.model),
        ("Ball", f"radius {inspection.tip_mm:g} mm"),
        ("Coordinates", f"{inspection.system}'s system"),
        (
            "Uncertainty",
            inspection.uncertainty_unknown
            or ". ".join(("U, k = 2", *inspection.left_out)),
        ),
    ]
    parts = [
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head><body><main>",
        f'<img class="logo" src="{logo}" alt="Logo">' if logo else "",
        f"<h1>{escape(title)}</h1>",
        f'<p class="verdict {_CLASSES.get(verdict, "doubt")}">{escape(verdict)}</p>',
        "<dl>",
        *(f"<dt>{name}</dt><dd>{_text(value or '-')}</dd>" for name, value in about),
        "</dl>",
        "<h2>Figures</h2>",
        _table(_HEAD, _figure_rows(inspection.features), 3),
        *_touch_tables(inspection.features),
        "<h2>Definitions</h2>",
        *(f'<p class="note">{escape(text)}</p>' for text in DEFINITIONS),
        f'<p class="note">Made {now:%Y-%m-%d %H:%M} UTC by Traverse.</p>',
        "</main></body></html>",
    ]
    return "\n".join(parts) + "\n"


_HEAD = ("Feature", "Kind", "Figure", "Value", "U", "Nominal", "Limits", "Decision")


def _figure_rows(features: Iterable[FeatureResult]) -> Iterator[tuple[str, list[str]]]:
    for feature in features:
        kind = " ".join((feature.kind, *(("of", *feature.of) if feature.of else ())))
        if feature.problem:
            yield "doubt", [feature.name, kind, feature.problem, *[""] * 5]
        for figure in feature.figures:
            value, expanded, _ = figure_words(figure)
            known = figure.nominal is not None
            yield (
                _CLASSES.get(figure.conformity or "", "doubt" if known else ""),
                [
                    *(feature.name, kind, figure.name, value, expanded),
                    f"{figure.nominal:g}" if known else "",
                    f"{figure.lower:+g} {figure.upper:+g}" if known else "",
                    figure.conformity or "",
                ],
            )


def _touch_tables(features: Iterable[FeatureResult]) -> Iterator[str]:
    for feature in features:
        if feature.touches:
            touches = [touch for touch in feature.touches if not touch.scan]
            n = counted(len(touches), "touch")
            yield f"<h2>{_text(feature.name)}: {n}</h2>"
            yield _table(
                ("Point", "Distance in mm", "In doubt"),
                [*map(_touch_row, touches), *_scan_rows(feature)],
                1,
            )


def _scan_rows(feature: FeatureResult) -> Iterator[tuple[str, list[str]]]:
    for part in feature.scans:
        samples = [touch for touch in feature.touches if touch.scan == part.scan]
        known_mm = [s.distance_mm for s in samples if s.distance_mm is not None]
        span = f"{min(known_mm):+.4f} to {max(known_mm):+.4f}" if known_mm else ""
        doubtful = sum(bool(sample.doubts) for sample in samples)
        doubts = f"{doubtful} of {part.used}" if doubtful else ""
        yield "doubt" if doubts else "", [part.words, span, doubts]


def _touch_row(touch: TouchResult) -> tuple[str, list[str]]:
    distance = "" if touch.distance_mm is None else f"{touch.distance_mm:+.4f}"
    doubts = ", ".join(touch.doubts).replace("_", " ")
    return ("doubt" if doubts else "", [str(touch.seq), distance, doubts])


def _table(
    head: Sequence[str], rows: Iterable[tuple[str, list[str]]], texts: int
) -> str:
    """Write a table whose first columns are texts; rows have a class and cells."""
    kinds = ["text" if column < texts else "" for column in range(len(head))]
    titles = "".join(
        f'<th scope="col" class="{kind}">{escape(title)}</th>'
        for kind, title in zip(kinds, head, strict=True)
    )
    body = "\n".join(
        f'<tr class="{of_row}">'
        + "".join(
            f'<td class="{kind}">{_text(cell)}</td>'
            for kind, cell in zip(kinds, cells, strict=True)
        )
        + "</tr>"
        for of_row, cells in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{titles}</tr></thead>\n'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def _text(value: str) -> str:
    return escape(printable(value))

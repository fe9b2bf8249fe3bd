"""One file out of a source: points or scans, filtered, whole or not at all."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from traverse.cli.common.qif_check import check_schema, schema_words
from traverse.cli.export.options import ExportOptions
from traverse.cli.export.sources import PIECE, points_of, scans_of, tear_of
from traverse.client.exports.formats import format_class
from traverse.client.exports.point_table import (
    PointTable,
    Sink,
    scan_table,
    table_of,
)
from traverse.daemon.config.filters import AnyFilter, filter_chain
from traverse.kinematics.filters import FilterChain, PointBlock
from traverse.plurals import counted
from traverse.protocol.messages import Point
from traverse.strict_toml.reader import StrictModel, read_strict
from traverse.strict_toml.writing import replacing

FILTERED = ("seq", "time_ns", "xyz_mm", "ijk", "quality", "covariance_mm2")
"""Columns that filters see, and hand on."""


class FiltersFile(StrictModel):
    """A file of filters."""

    filters: tuple[AnyFilter, ...]


def write_file(
    source: Path, path: Path, export_options: ExportOptions
) -> dict[str, Any]:
    """Write a file; return its summary.

    Raises:
        ValueError: source, filters or options do not go together.
        OSError: a file cannot be read or written.
    """
    chain = None
    if export_options.filters is not None:
        chain = filter_chain(read_strict(export_options.filters, FiltersFile).filters)
        if chain.interpolates and export_options.kind == "points":
            raise ValueError(
                f"{export_options.filters}: sections make points between samples; use "
                "--kind scans"
            )
    options: dict[str, Any] = {"coordinates": export_options.coordinates}
    if export_options.to == "text":
        options["template"] = export_options.template
    elif export_options.template:
        raise ValueError("--template needs --to text")
    if export_options.decimal != ".":
        if export_options.to not in ("csv", "text", "xyz"):
            raise ValueError("--decimal needs --to csv, text or xyz")
        options["decimal"] = export_options.decimal
    if export_options.to == "qif" and export_options.schemas is not None:
        options["check"] = partial(
            check_schema, file=path, schemas=export_options.schemas
        )
    with (
        replacing(path) as file,
        format_class(export_options.to)(file, **options) as sink,
    ):
        if export_options.kind == "scans":
            _write_scans(source, sink, chain, export_options)
        else:
            _write_points(source, sink, chain, export_options)
    passed = [] if chain is None else zip(chain.filters, chain.removed, strict=True)
    return {
        "file": str(path),
        "kind": export_options.kind,
        "points": sink.n,
        "in_doubt": sink.in_doubt,
        "lacks": _lacks(sink, export_options),
        "held_back": [
            {"filter": step.kind, "points": removed}
            for step, removed in passed
            if not step.interpolates
        ],
        "tear": tear_of(source),
        **(
            {"schema": schema_words(export_options.schemas)}
            if export_options.to == "qif"
            else {}
        ),
    }


def _lacks(sink: Sink, export_options: ExportOptions) -> str:
    """Name known values that the file cannot hold."""
    of_part = ""
    if export_options.coordinates == "part" and export_options.to not in (
        "csv",
        "jsonl",
        "xyz",
    ):
        of_part = "uncertainties, which are of the arm's system"
    return "; ".join(filter(None, (sink.lacks, of_part)))


def file_words(source: Path, report: dict[str, Any]) -> list[str]:
    origin = " of scans" if report["kind"] == "scans" else ""
    doubt = f", {report['in_doubt']} in doubt" if report["in_doubt"] else ""
    lines = [f"{report['file']}: {counted(report['points'], 'point')}{origin}{doubt}"]
    if report["lacks"]:
        lines.append(f"not in this file: {report['lacks']}")
    lines += [
        f"filter {step['filter']}: {step['points']} held back"
        for step in report["held_back"]
    ]
    if "schema" in report:
        lines.append(report["schema"])
    if report["tear"] is not None:
        lines.append(f"{source}: read up to a tear: {report['tear']}")
    return lines


def selected_points(
    source: Path, session: str | None, *, retracted: bool
) -> Iterator[Point]:
    """Points of a source; without retracted ones, unless requested."""
    retracted_ids: set[str] = set()
    if not retracted:
        # Retractions are known only after a full read: so the file is read twice.
        retracted_ids = {
            p.retracts for p in points_of(source) if p.retracts is not None
        }
    for point in points_of(source):
        if session is not None and point.session != session:
            continue
        if retracted or (point.retracts is None and point.id not in retracted_ids):
            yield point


def _write_points(
    source: Path, sink: Sink, chain: FilterChain | None, export_options: ExportOptions
) -> None:
    chosen = selected_points(
        source, export_options.session, retracted=export_options.retracted
    )
    for piece in _pieces(chosen):
        sink.points(piece if chain is None else _passing(piece, chain))


def _pieces(points: Iterator[Point]) -> Iterator[list[Point]]:
    while True:
        piece = list(islice(points, PIECE))
        yield piece
        if len(piece) < PIECE:
            return


def _passing(points: Sequence[Point], chain: FilterChain) -> list[Point]:
    rows = replace(table_of(points, "centre"), seq=np.arange(len(points)))
    return [points[row] for row in _applied(chain, rows).seq.tolist()]


def _applied(chain: FilterChain, table: PointTable) -> PointBlock:
    none = np.zeros((len(table), 0))
    columns = {name: getattr(table, name) for name in FILTERED}
    counts = none.astype(np.int64)
    return chain.apply(PointBlock(**columns, angles_rad=none, counts=counts))


def _write_scans(
    source: Path, sink: Sink, chain: FilterChain | None, export_options: ExportOptions
) -> None:
    if export_options.coordinates != "centre":
        raise ValueError("scans of a recording have --coordinates centre only")
    for table in scans_of(source):
        sink.table(table if chain is None else _filtered(table, chain))


def _filtered(table: PointTable, chain: FilterChain) -> PointTable:
    passed = _applied(chain, table)
    names = (str(table.session[0]), str(table.scan[0])) if len(table) else ("", "")
    return scan_table(*names, **{name: getattr(passed, name) for name in FILTERED})

"""Formats of text: CSV, JSON lines, XYZ, and line templates."""

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from traverse.client.exports.line_template import LineTemplate
from traverse.client.exports.point_table import Coordinates, PointTable, Sink, place_of
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point
from traverse.protocol.printable import spreadsheet_cell

TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
COLUMNS = (
    *("session", "seq", "id", "retracts", "time_ns", "time_utc", "trigger"),
    *("x_mm", "y_mm", "z_mm"),
    *("i", "j", "k"),
    *("surface_x_mm", "surface_y_mm", "surface_z_mm"),
    "compensation",
    *("part_x_mm", "part_y_mm", "part_z_mm"),
    *(f"covariance_{axes}_mm2" for axes in TENSOR),
    *("temperature_c", "probe_radius_mm", "samples", "spread_mm"),
    *("artefact", "feature", "ok", "flags", "model", "angles_rad", "counts"),
    "time_bound_ns",
)
"""Columns of a point in CSV, and the names of a template."""
SCAN_COLUMNS = (
    *(
        "session",
        "scan",
        "seq",
        "time_ns",
        "time_utc",
        "x_mm",
        "y_mm",
        "z_mm",
        "i",
        "j",
        "k",
    ),
    *("std_x_mm", "std_y_mm", "std_z_mm", "ok", "flags"),
    *(f"covariance_{axes}_mm2" for axes in TENSOR),
)
"""Columns of a point of a scan."""
WORDS = {
    *("session", "id", "retracts", "time_utc", "trigger", "compensation"),
    *("artefact", "feature", "flags", "model", "angles_rad", "counts"),
}
NUMBERS = {"seq", "time_ns", "samples", "ok", "time_bound_ns"}
SPECIMEN: dict[str, Any] = {
    name: "a" if name in WORDS else 1 if name in NUMBERS else 1.0
    for name in (*"xyz", *COLUMNS)
}
"""A value of each name of a template: x, y, z are the chosen coordinates."""
LABEL = slice(COLUMNS.index("artefact"), COLUMNS.index("feature") + 1)


def row_of(point: Point) -> list[Any]:
    """Return a point in the order of `COLUMNS`; None for unknown values."""
    return [
        *(point.session, point.seq, point.id, point.retracts),
        *(point.time_ns, *iso_times([point.time_ns]), point.trigger),
        *point.xyz_mm,
        *point.ijk,
        *(point.surface_mm or [None] * 3),
        point.compensation,
        *(point.part_xyz_mm or [None] * 3),
        *(point.covariance_mm2 or [None] * 6),
        *(point.temperature_c, point.probe_radius_mm, point.samples, point.spread_mm),
        *(point.label.artefact, point.label.feature, int(point.quality.ok)),
        *(" ".join(point.quality.flags), point.model),
        " ".join(map(repr, point.angles_rad)),
        " ".join(map(str, point.counts)),
        point.time_bound_ns,
    ]


def values_of(
    point: Point, coordinates: Coordinates, unit_mm: float = 1.0
) -> dict[str, Any]:
    """Return the values of a template's names.

    Raises:
        ValueError: the point has no such coordinates.
    """
    values = dict(zip(COLUMNS, row_of(point), strict=True))
    place_mm = place_of(point, coordinates)
    return values | _in_unit(place_mm, unit_mm)


def scan_values(table: PointTable, unit_mm: float = 1.0) -> Iterable[dict[str, Any]]:
    """Return a template's values of each point of a scan, as far as known."""
    for row in scan_rows(table):
        values = dict(zip(SCAN_COLUMNS, row, strict=True))
        yield values | _in_unit([values[f"{axis}_mm"] for axis in "xyz"], unit_mm)


def _in_unit(place_mm: Iterable[float], unit_mm: float) -> dict[str, float]:
    return dict(zip("xyz", (mm / unit_mm for mm in place_mm), strict=True))


def scan_rows(table: PointTable) -> Iterable[list[Any]]:
    columns = zip(
        table.session.tolist(),
        table.scan.tolist(),
        table.seq.tolist(),
        table.time_ns.tolist(),
        iso_times(table.time_ns),
        table.xyz_mm.tolist(),
        table.ijk.tolist(),
        table.std_mm.tolist(),
        table.ok.tolist(),
        table.flags.tolist(),
        table.covariance_mm2.tolist(),
        strict=True,
    )
    for *key, xyz_mm, ijk, std_mm, ok, flags, covariance_mm2 in columns:
        known = _where_known(std_mm), _where_known(covariance_mm2)
        yield [*key, *xyz_mm, *ijk, *known[0], int(ok), flags, *known[1]]


def _where_known(values: Iterable[float]) -> list[float | None]:
    return [None if math.isnan(value) else value for value in values]


def iso_times(time_ns: ArrayLike) -> list[str]:
    """Write times [ns, UTC] as ISO 8601 with all nine digits of a second."""
    times = np.asarray(time_ns, dtype="datetime64[ns]")
    return [str(text) for text in np.datetime_as_string(times, timezone="UTC")]


class Csv(Sink):
    """Comma-separated, a header line first; unknown values are empty.

    Labels that a spreadsheet would read as formulas get an apostrophe first.

    Args:
        coordinates: are not looked at: all are columns.
        decimal: sign of numbers; with a comma semicolons are between columns, as the
            spreadsheets have it that read a point between digits as thousands.
    """

    _has_head = False

    def __init__(
        self, file: IO[bytes], coordinates: Coordinates = "centre", decimal: str = "."
    ) -> None:
        super().__init__(file, coordinates)
        self._decimal = decimal

    def points(self, points: Sequence[Point]) -> None:
        self._check(points)
        rows = [row_of(point) for point in points]
        for row in rows:
            row[LABEL] = [name and spreadsheet_cell(name) for name in row[LABEL]]
        self._write(COLUMNS, rows)

    def table(self, table: PointTable) -> None:
        self._write(SCAN_COLUMNS, list(scan_rows(table)))
        self.in_doubt += int(np.count_nonzero(~table.ok))

    def _write(self, columns: Sequence[str], rows: Sequence[list[Any]]) -> None:
        text = io.StringIO()
        separator = "," if self._decimal == "." else ";"
        writer = csv.writer(text, delimiter=separator, lineterminator="\n")
        if not self._has_head:
            self._has_head = True
            writer.writerow(columns)
        if self._decimal != ".":
            rows = [_with_decimal(columns, row, self._decimal) for row in rows]
        writer.writerows(rows)
        self._file.write(text.getvalue().encode())
        self.n += len(rows)


def _with_decimal(
    columns: Sequence[str], row: Sequence[Any], decimal: str
) -> list[Any]:
    """Write the numbers of a row with another decimal sign."""
    return [
        str(value).replace(".", decimal)
        if isinstance(value, float) or name == "angles_rad"
        else value
        for name, value in zip(columns, row, strict=True)
    ]


class JsonLines(Sink):
    """One JSON object a line: of points the message, of scans the columns."""

    def points(self, points: Sequence[Point]) -> None:
        self._check(points)
        for point in points:
            self._file.write(encode(point, "json") + b"\n")
        self.n += len(points)

    def table(self, table: PointTable) -> None:
        for row in scan_rows(table):
            named = dict(zip(SCAN_COLUMNS, row, strict=True))
            self._file.write(json.dumps(named).encode() + b"\n")
        self._count(table)


class Xyz(Sink):
    """Three columns of numbers, as software for point clouds reads them."""

    lacks = (
        "sessions, numbers, ids, labels, times, quality and uncertainty: what is in "
        "doubt is not marked"
    )

    def __init__(
        self, file: IO[bytes], coordinates: Coordinates = "centre", decimal: str = "."
    ) -> None:
        super().__init__(file, coordinates)
        self._decimal = decimal

    def table(self, table: PointTable) -> None:
        lines = [f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in table.xyz_mm.tolist()]
        self._file.write("".join(lines).replace(".", self._decimal).encode())
        self._count(table)


class Template(Sink):
    """Lines of a template, as a keyboard wedge would type them.

    Args:
        coordinates: of `{x}`, `{y}` and `{z}`.
        template: see `LineTemplate`.
        decimal: sign of numbers.

    Raises:
        ValueError: the template is refused.
    """

    def __init__(
        self,
        file: IO[bytes],
        coordinates: Coordinates = "centre",
        template: str = "",
        decimal: str = ".",
    ) -> None:
        super().__init__(file, coordinates)
        self._template = LineTemplate(template, SPECIMEN, decimal)
        if self._template.names.isdisjoint({"ok", "flags"}):
            self.lacks = "quality: what is in doubt is not marked; {ok} and {flags} are"

    def points(self, points: Sequence[Point]) -> None:
        self._check(points)
        for point in points:
            self._write(values_of(point, self._coordinates))

    def table(self, table: PointTable) -> None:
        for values in scan_values(table):
            self._write(values)
        self.in_doubt += int(np.count_nonzero(~table.ok))

    def _write(self, values: dict[str, Any]) -> None:
        self._file.write(self._template.filled(values).encode())
        self.n += 1

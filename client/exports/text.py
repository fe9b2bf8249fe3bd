"""Formats of text: CSV, JSON lines, XYZ, and templates of one's own."""

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from string import Formatter
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike

from traverse.client.exports.point_table import Coordinates, PointTable
from traverse.client.exports.sink import Sink
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Point, Quality
from traverse.protocol.printable import printable

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
)
"""Of a point in CSV, and the names of a template."""
SCAN_COLUMNS = (
    *("seq", "time_ns", "time_utc", "x_mm", "y_mm", "z_mm", "i", "j", "k"),
    *("std_x_mm", "std_y_mm", "std_z_mm", "ok", "flags"),
)
"""Of a point of a scan."""
MAX_TEMPLATE = 1000
LABEL = slice(COLUMNS.index("artefact"), COLUMNS.index("feature") + 1)
FORMULA = tuple("=+-@")


def row_of(point: Point) -> list[Any]:
    """A point in the order of `COLUMNS`; None for what is not known."""
    return [
        *(point.session, point.seq, point.id, point.retracts),
        *(point.time_ns, *_iso_times([point.time_ns]), point.trigger),
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
    ]


def scan_rows(table: PointTable) -> Iterable[list[Any]]:
    """Rows of a scan in the order of `SCAN_COLUMNS`."""
    columns = zip(
        table.seq.tolist(),
        table.time_ns.tolist(),
        _iso_times(table.time_ns),
        table.xyz_mm.tolist(),
        table.ijk.tolist(),
        table.std_mm.tolist(),
        table.quality.tolist(),
        strict=True,
    )
    for seq, time_ns, time_utc, xyz_mm, ijk, std_mm, bits in columns:
        quality = Quality.from_bits(bits)
        known = [None if math.isnan(std) else std for std in std_mm]
        said = (int(quality.ok), " ".join(quality.flags))
        yield [seq, time_ns, time_utc, *xyz_mm, *ijk, *known, *said]


def _iso_times(time_ns: ArrayLike) -> list[str]:
    """Write times [ns, UTC] as ISO 8601 with all nine digits of a second."""
    times = np.asarray(time_ns, dtype="datetime64[ns]")
    return [str(text) for text in np.datetime_as_string(times, timezone="UTC")]


class Csv(Sink):
    """Comma-separated, a header line first; what is not known is empty.

    A label that a spreadsheet would take for a formula has an apostrophe before it.
    """

    _has_head = False

    def points(self, points: Sequence[Point]) -> None:
        """Write points with all that is known of them."""
        rows = [row_of(point) for point in points]
        for row in rows:
            row[LABEL] = [_not_a_formula(name) for name in row[LABEL]]
        self._write(COLUMNS, rows)

    def table(self, table: PointTable) -> None:
        """Write rows of a scan."""
        self._write(SCAN_COLUMNS, list(scan_rows(table)))

    def _write(self, columns: Sequence[str], rows: Sequence[list[Any]]) -> None:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if not self._has_head:
            self._has_head = True
            writer.writerow(columns)
        writer.writerows(rows)
        self._file.write(text.getvalue().encode())
        self.n += len(rows)


def _not_a_formula(name: str | None) -> str | None:
    if name is None:
        return None
    return printable(f"'{name}" if name.startswith(FORMULA) else name)


class JsonLines(Sink):
    """One object a line: of points the message, of scans an object of its columns."""

    def points(self, points: Sequence[Point]) -> None:
        """Write messages as they were published, in JSON."""
        for point in points:
            self._file.write(encode(point, "json") + b"\n")
        self.n += len(points)

    def table(self, table: PointTable) -> None:
        """Write rows of a scan."""
        for row in scan_rows(table):
            named = dict(zip(SCAN_COLUMNS, row, strict=True))
            self._file.write(json.dumps(named).encode() + b"\n")
        self.n += len(table)


class Xyz(Sink):
    """Three columns of numbers, as most software for point clouds reads them."""

    def table(self, table: PointTable) -> None:
        """Write coordinates, with digits to a nanometre."""
        lines = [f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in table.xyz_mm.tolist()]
        self._file.write("".join(lines).encode())
        self.n += len(table)


class Template(Sink):
    r"""Lines of one's own form, as a keyboard wedge would type them.

    Args:
        file: open for writing.
        coordinates: only the centre's have names here; others have their own.
        template: text with `{name}` or `{name:.3f}`; `\n` and `\t` are understood.

    Raises:
        ValueError: it names what a point does not have, or contains more than names.
    """

    def __init__(
        self, file: IO[bytes], coordinates: Coordinates = "centre", template: str = ""
    ) -> None:
        super().__init__(file, coordinates)
        if not template or len(template) > MAX_TEMPLATE:
            raise ValueError(
                f"a template of {len(template)} characters; expected 1 to "
                f"{MAX_TEMPLATE}, such as '{{seq}};{{x_mm:.3f}}\\n'"
            )
        text = template.replace("\\n", "\n").replace("\\t", "\t")
        # Parsed by hand: str.format would give a template access to our objects.
        self._parts = list(Formatter().parse(text))
        for _, name, spec, conversion in self._parts:
            if name is None:
                continue
            if name not in COLUMNS or conversion or "{" in (spec or ""):
                raise ValueError(
                    f"template: {{{name}}} is no value of a point; there are: "
                    + ", ".join(COLUMNS)
                )

    def points(self, points: Sequence[Point]) -> None:
        """Write points by the template."""
        for point in points:
            values = dict(zip(COLUMNS, row_of(point), strict=True))
            self._file.write(self._filled(values).encode())
        self.n += len(points)

    def table(self, table: PointTable) -> None:
        """Write rows of a scan by the template."""
        for row in scan_rows(table):
            values = dict(zip(SCAN_COLUMNS, row, strict=True))
            self._file.write(self._filled(values).encode())
        self.n += len(table)

    def _filled(self, values: dict[str, Any]) -> str:
        parts = []
        for text, name, spec, _ in self._parts:
            parts.append(text)
            if name is not None:
                value = values.get(name)
                try:
                    parts.append("" if value is None else format(value, spec or ""))
                except ValueError as error:
                    raise ValueError(
                        f"template: {{{name}:{spec}}}: {error}; the value is {value!r}"
                    ) from error
        return "".join(parts)

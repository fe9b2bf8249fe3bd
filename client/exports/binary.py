"""Binary formats: PLY, NumPy, Parquet."""

import tempfile
from collections.abc import Iterable
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from traverse.client.exports.point_table import (
    WORDS,
    Coordinates,
    PointTable,
    Sink,
    table_of,
)
from traverse.client.exports.text import TENSOR

PLY_ROW = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        *((f"n{axis}", "<f4") for axis in "xyz"),
        *((f"std_{axis}", "<f4") for axis in "xyz"),
        *((f"cov_{axes}", "<f4") for axes in TENSOR),
        ("series", "<i4"),
        ("seq", "<i4"),
        ("label", "<i4"),
        ("quality", "<u4"),
        ("ok", "u1"),
    ]
)
"""One vertex: normals point from the material along the shank, back to the wrist."""
_PLY_TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "<u4": "uint"}
_PLY_TYPES["|u1"] = "uchar"
_IN_MEMORY_BYTES = 64_000_000


class Ply(Sink):
    """Binary little-endian PLY; lengths in millimetres.

    A vertex has numbers alone: sessions, scans and labels are numbered, and named in
    the head.
    """

    lacks = "ids and times of points"

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        self._rows = tempfile.SpooledTemporaryFile(_IN_MEMORY_BYTES)  # noqa: SIM115 - closed in __exit__
        self._series: dict[str, int] = {}
        self._labels: dict[str, int] = {}

    def table(self, table: PointTable) -> None:
        rows = np.zeros(len(table), PLY_ROW)
        for column, axis in enumerate("xyz"):
            rows[axis] = table.xyz_mm[:, column]
            rows[f"n{axis}"] = -table.ijk[:, column]
            rows[f"std_{axis}"] = table.std_mm[:, column]
        for column, axes in enumerate(TENSOR):
            rows[f"cov_{axes}"] = table.covariance_mm2[:, column]
        for name in ("seq", "quality", "ok"):
            rows[name] = getattr(table, name)
        keys = zip(table.session.tolist(), table.scan.tolist(), strict=True)
        names = (
            f"scan {scan} of session {session}" if scan else f"session {session}"
            for session, scan in keys
        )
        rows["series"] = _numbered(names, self._series)
        labels = zip(table.artefact, table.feature, strict=True)
        rows["label"] = _numbered(
            (" ".join(filter(None, label)) for label in labels), self._labels
        )
        self._rows.write(rows.tobytes())
        self._count(table)

    def end(self) -> None:
        lines = [
            "ply",
            "format binary_little_endian 1.0",
            f"comment Traverse: x y z std in mm, cov in mm2, {self._coordinates}",
            "comment quality: bits of the table of quality flags; ok 0: in doubt",
            "comment series and seq are the key of a point",
            f"comment not in this file: {self.lacks}",
            *(f"comment series {n}: {name}" for name, n in self._series.items()),
            *(f"comment label {n}: {name}" for name, n in self._labels.items()),
            f"element vertex {self.n}",
            *(
                f"property {_PLY_TYPES[PLY_ROW[name].str]} {name}"
                for name in PLY_ROW.names or ()
            ),
            "end_header",
        ]
        # The head is ASCII, and a name must not break a line.
        text = "\n".join(ascii(line)[1:-1] for line in lines)
        self._file.write(text.encode() + b"\n")
        self._rows.seek(0)
        while piece := self._rows.read(1 << 20):
            self._file.write(piece)

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        with self._rows:
            super().__exit__(kind, error, trace)


def _numbered(names: Iterable[str], numbers: dict[str, int]) -> list[int]:
    return [numbers.setdefault(name, len(numbers)) for name in names]


class Numpy(Sink):
    """A compressed `.npz` of columns, held in memory until the end."""

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        self._tables: list[PointTable] = []

    def table(self, table: PointTable) -> None:
        self._tables.append(table)
        self._count(table)

    def end(self) -> None:
        columns: dict[str, NDArray[Any]] = {"coordinates": np.array(self._coordinates)}
        tables = self._tables or [table_of([], self._coordinates)]
        for name in PointTable.__slots__:
            columns[name] = np.concatenate([getattr(table, name) for table in tables])
        np.savez_compressed(self._file, allow_pickle=False, **columns)


class Parquet(Sink):
    """Apache Parquet, one row group a piece; needs the extra `parquet`."""

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        import pyarrow  # noqa: PLC0415 - heavy, and an extra
        from pyarrow import parquet  # noqa: PLC0415

        self._arrow = pyarrow
        number = pyarrow.float64()
        self._schema = pyarrow.schema(
            [
                ("seq", pyarrow.int64()),
                ("time", pyarrow.timestamp("ns", tz="UTC")),
                *((f"{axis}_mm", number) for axis in "xyz"),
                *((axis, number) for axis in "ijk"),
                *((f"std_{axis}_mm", number) for axis in "xyz"),
                *((f"covariance_{axes}_mm2", number) for axes in TENSOR),
                ("time_bound_ns", pyarrow.int64()),
                ("quality", pyarrow.uint32()),
                ("ok", pyarrow.bool_()),
                *((name, pyarrow.string()) for name in WORDS),
            ],
            metadata={
                "coordinates": coordinates,
                "made_by": "traverse",
                "key": "session and seq; of scans session, scan and seq",
            },
        )
        self._writer = parquet.ParquetWriter(file, self._schema)

    def table(self, table: PointTable) -> None:
        columns = [
            self._arrow.array(table.seq),
            self._arrow.array(table.time_ns).cast(self._schema.field("time").type),
            *(self._arrow.array(table.xyz_mm[:, i]) for i in range(3)),
            *(self._arrow.array(table.ijk[:, i]) for i in range(3)),
            # NaN means unknown: a null.
            *(
                self._arrow.array(table.std_mm[:, i], from_pandas=True)
                for i in range(3)
            ),
            *(
                self._arrow.array(table.covariance_mm2[:, i], from_pandas=True)
                for i in range(6)
            ),
            self._arrow.array(table.time_bound_ns, from_pandas=True).cast(
                self._arrow.int64()
            ),
            self._arrow.array(table.quality),
            self._arrow.array(table.ok),
            # An empty text is a null, too, but for the flags: there are none.
            *(
                self._arrow.array(
                    [text or (text if name == "flags" else None) for text in texts],
                    self._arrow.string(),
                )
                for name in WORDS
                for texts in (getattr(table, name).tolist(),)
            ),
        ]
        self._writer.write_table(
            self._arrow.Table.from_arrays(columns, schema=self._schema)
        )
        self._count(table)

    def end(self) -> None:
        self._writer.close()

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.end()  # after an error, too: else it is closed when the file is

"""Binary formats: PLY, NumPy, Parquet."""

from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from traverse.client.exports.point_table import Coordinates, PointTable, Sink

PLY_ROW = np.dtype(
    [
        *((axis, "<f8") for axis in "xyz"),
        *((f"n{axis}", "<f4") for axis in "xyz"),
        *((f"std_{axis}", "<f4") for axis in "xyz"),
        ("seq", "<i4"),
        ("quality", "<u4"),
    ]
)
"""One vertex: normals point from the material along the shank, back to the wrist."""
_PLY_TYPES = {"<f8": "double", "<f4": "float", "<i4": "int", "<u4": "uint"}
_COUNT_WIDTH = 12


class Ply(Sink):
    """Binary little-endian PLY; lengths in millimetres."""

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        self._file.write(
            b"ply\nformat binary_little_endian 1.0\n"
            b"comment Traverse: x y z std in mm, " + coordinates.encode() + b"\n"
            b"comment quality: bits of the table of quality flags, 0 is good\n"
            b"element vertex "
        )
        self._count_at = self._file.tell()
        lines = [b"0".rjust(_COUNT_WIDTH)]  # corrected at the end
        for name in PLY_ROW.names or ():
            kind = _PLY_TYPES[PLY_ROW[name].str]
            lines.append(f"property {kind} {name}".encode())
        self._file.write(b"\n".join([*lines, b"end_header\n"]))

    def table(self, table: PointTable) -> None:
        """Write rows."""
        rows = np.zeros(len(table), PLY_ROW)
        for column, axis in enumerate("xyz"):
            rows[axis] = table.xyz_mm[:, column]
            rows[f"n{axis}"] = -table.ijk[:, column]
            rows[f"std_{axis}"] = table.std_mm[:, column]
        rows["seq"], rows["quality"] = table.seq, table.quality
        self._file.write(rows.tobytes())
        self.n += len(table)

    def end(self) -> None:
        """Write how many there are into the head."""
        self._file.seek(self._count_at)
        self._file.write(str(self.n).encode().rjust(_COUNT_WIDTH))


class Numpy(Sink):
    """A compressed `.npz` of columns; all of them are held in memory until the end."""

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        self._tables: list[PointTable] = []

    def table(self, table: PointTable) -> None:
        """Keep rows."""
        self._tables.append(table)
        self.n += len(table)

    def end(self) -> None:
        """Write all columns."""
        names = PointTable.__slots__
        columns: dict[str, NDArray[Any]] = {}
        for name in names:
            parts = [getattr(table, name) for table in self._tables]
            if not parts:
                wide = name in ("xyz_mm", "ijk", "std_mm")
                parts = [np.empty((0, 3) if wide else 0)]
            columns[name] = np.concatenate(parts)
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
                ("quality", pyarrow.uint32()),
            ],
            metadata={"coordinates": coordinates, "made_by": "traverse"},
        )
        self._writer = parquet.ParquetWriter(file, self._schema)

    def table(self, table: PointTable) -> None:
        """Write a row group."""
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
            self._arrow.array(table.quality),
        ]
        self._writer.write_table(
            self._arrow.Table.from_arrays(columns, schema=self._schema)
        )
        self.n += len(table)

    def end(self) -> None:
        """Write the foot."""
        self._writer.close()

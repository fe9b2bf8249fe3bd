"""Points as ASCII clouds, `x y z nx ny nz` in millimetres."""

from traverse.client.exports.point_table import PointTable, Sink


class Asc(Sink):
    """A line a point; the normal is the direction of the probe's shank."""

    lacks = "quality, labels, uncertainties"

    def table(self, table: PointTable) -> None:
        """Write points."""
        for place_mm, direction in zip(table.xyz_mm, table.ijk, strict=True):
            values = (*place_mm.tolist(), *direction.tolist())
            self._file.write((" ".join(map(repr, values)) + "\n").encode())
        self._count(table)

"""Drawings (DXF) of points and scans, for CAD."""

import io
import re
from collections.abc import Sequence
from typing import IO

import numpy as np
from numpy.typing import ArrayLike

from traverse.client.exports.point_table import Coordinates, PointTable, Sink, place_of
from traverse.protocol.messages import Point, Quality

IN_DOUBT = "in doubt"
_NOT_IN_LAYER = re.compile(r'[<>/\\":;?*|=`,\x00-\x1f\x7f]')
_RED, _CROSS = 1, 2


class Dxf(Sink):
    """A drawing in millimetres, DXF of AutoCAD 2010; all of it is held until the end.

    A point is a POINT on the layer of its session and label. A scan is a 3D POLYLINE on
    a layer of its own; numbers that begin again begin the next scan. What is in doubt
    is a POINT on a red layer, and ends a polyline. Needs the extra `lab`.
    """

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        from ezdxf import units  # noqa: PLC0415 - slow, and of an extra
        from ezdxf.filemanagement import new  # noqa: PLC0415

        self._drawing = new("R2010", units=units.MM)
        self._drawing.header["$PDMODE"] = _CROSS
        self._drawing.layers.add(IN_DOUBT, color=_RED)
        self._space = self._drawing.modelspace()
        self._ends_mm = np.empty((0, 3))
        self._way_mm: list[tuple[float, float, float]] = []
        self._scans, self._last_seq = 0, 0

    def points(self, points: Sequence[Point]) -> None:
        """Add points."""
        places_mm = [place_of(point, self._coordinates) for point in points]
        for point, place_mm in zip(points, places_mm, strict=True):
            names = (point.session, point.label.artefact, point.label.feature)
            layer = _NOT_IN_LAYER.sub("_", " ".join(filter(None, names)))
            layer = layer if point.quality.ok else IN_DOUBT
            self._space.add_point(place_mm, {"layer": layer})
        self._count(places_mm, len(points))

    def table(self, table: PointTable) -> None:
        """Add rows of a scan."""
        columns = (table.seq, table.xyz_mm, table.quality)
        for seq, xyz_mm, bits in zip(*(c.tolist() for c in columns), strict=True):
            if self._scans == 0 or seq <= self._last_seq:
                self._end_way()
                self._scans += 1
            self._last_seq = seq
            if Quality.from_bits(bits).ok:
                self._way_mm.append(tuple(xyz_mm))
            else:
                self._end_way()
                self._space.add_point(xyz_mm, {"layer": IN_DOUBT})
        self._count(table.xyz_mm, len(table))

    def end(self) -> None:
        """Write the drawing."""
        self._end_way()
        layers = self._drawing.layers
        for layer in sorted({entity.dxf.layer for entity in self._space}):
            if layer not in layers:  # CAD takes "Plate" and "plate" as one
                layers.add(layer)
        if self.n:
            low_mm, high_mm = self._ends_mm
            middle_mm = (low_mm + high_mm) / 2.0
            height_mm = 1.2 * max(float(np.max(high_mm - low_mm)), 1.0)
            self._drawing.set_modelspace_vport(height_mm, middle_mm[:2].tolist())
            self._space.reset_extents(low_mm.tolist(), high_mm.tolist())
        text = io.TextIOWrapper(
            self._file, self._drawing.output_encoding, "dxfreplace", "\n"
        )
        self._drawing.write(text)
        text.detach()

    def _end_way(self) -> None:
        layer = {"layer": f"scan {self._scans}"}
        if len(self._way_mm) > 1:
            self._space.add_polyline3d(self._way_mm, dxfattribs=layer)
        elif self._way_mm:
            self._space.add_point(self._way_mm[0], layer)
        self._way_mm = []

    def _count(self, places_mm: ArrayLike, n: int) -> None:
        """Note how many there are, and the corners of what they fill."""
        if n:
            all_mm = np.vstack([self._ends_mm, np.reshape(places_mm, (-1, 3))])
            self._ends_mm = np.vstack([all_mm.min(axis=0), all_mm.max(axis=0)])
        self.n += n

"""Drawings (DXF) of points and scans, for CAD."""

import io
import re
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from traverse.client.exports.point_table import Coordinates, PointTable, Sink, place_of
from traverse.protocol.messages import Point
from traverse.protocol.printable import printable

if TYPE_CHECKING:
    from ezdxf.document import Drawing

IN_DOUBT = "in doubt"
APPLICATION = "TRAVERSE"
_TEXT, _MAX_TEXT = 1000, 255
_NOT_IN_LAYER = re.compile(r'[<>/\\":;?*|=`,\x00-\x1f\x7f]')
RED, WHITE, _CROSS = 1, 7, 2


class Dxf(Sink):
    """A drawing in millimetres, DXF of AutoCAD 2010, held until the end.

    A point is a POINT on the layer of its session and label. A scan is a 3D POLYLINE on
    a layer of its own; numbers that begin again begin the next line. A point in doubt
    is a POINT on a red layer, and ends a polyline. Session or scan, seq, id, label,
    flags and covariance are extended data (XDATA of TRAVERSE). Needs the extra `lab`.
    """

    lacks = "times, and numbers within the lines of scans"

    def __init__(self, file: IO[bytes], coordinates: Coordinates = "centre") -> None:
        super().__init__(file, coordinates)
        self._drawing = new_drawing()
        self._drawing.layers.add(IN_DOUBT, color=RED)
        self._space = self._drawing.modelspace()
        self._ends_mm = np.empty((0, 3))
        self._way_mm: list[tuple[float, float, float]] = []
        self._scans, self._last_seq, self._key = 0, 0, ("", "")

    def points(self, points: Sequence[Point]) -> None:
        self._check(points)
        places_mm = [place_of(point, self._coordinates) for point in points]
        for point, place_mm in zip(points, places_mm, strict=True):
            names = (point.session, point.label.artefact, point.label.feature)
            layer = layer_name(" ".join(filter(None, names)))
            layer = layer if point.quality.ok else IN_DOUBT
            added = self._space.add_point(place_mm, {"layer": layer})
            tensor = point.covariance_mm2 if self._coordinates != "part" else None
            added.set_xdata(
                APPLICATION,
                extended_data(
                    session=point.session,
                    seq=point.seq,
                    id=point.id,
                    artefact=point.label.artefact,
                    feature=point.label.feature,
                    ok=str(point.quality.ok).lower(),
                    flags=" ".join(point.quality.flags),
                    covariance_mm2=tensor and " ".join(map(repr, tensor)),
                ),
            )
        self._extend(places_mm, len(points))

    def table(self, table: PointTable) -> None:
        names = ("seq", "xyz_mm", "ok", "flags", "session", "scan")
        columns = (getattr(table, name).tolist() for name in names)
        for seq, xyz_mm, ok, flags, session, scan in zip(*columns, strict=True):
            key = session, scan
            if self._scans == 0 or seq <= self._last_seq or key != self._key:
                self._end_way()
                self._scans += 1
            self._last_seq, self._key = seq, key
            if ok:
                self._way_mm.append(tuple(xyz_mm))
            else:
                self._end_way()
                added = self._space.add_point(xyz_mm, {"layer": IN_DOUBT})
                named = {"session": session, "scan": scan}
                point_data = extended_data(**named, seq=seq, ok="false", flags=flags)
                added.set_xdata(APPLICATION, point_data)
        self._extend(table.xyz_mm, len(table))
        self.in_doubt += int(np.count_nonzero(~table.ok))

    def end(self) -> None:
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
        write_drawing(self._drawing, self._file)

    def _end_way(self) -> None:
        layer = {"layer": f"scan {self._scans}"}
        if self._way_mm:
            added: Any = (
                self._space.add_polyline3d(self._way_mm, dxfattribs=layer)
                if len(self._way_mm) > 1
                else self._space.add_point(self._way_mm[0], layer)
            )
            session, scan = self._key
            added.set_xdata(APPLICATION, extended_data(session=session, scan=scan))
        self._way_mm = []

    def _extend(self, places_mm: ArrayLike, n: int) -> None:
        """Update the number of points and their bounds."""
        if n:
            all_mm = np.vstack([self._ends_mm, np.reshape(places_mm, (-1, 3))])
            self._ends_mm = np.vstack([all_mm.min(axis=0), all_mm.max(axis=0)])
        self.n += n


def new_drawing() -> "Drawing":
    """Begin a drawing in millimetres, DXF of AutoCAD 2010."""
    from ezdxf import units  # noqa: PLC0415 - slow, and of an extra
    from ezdxf.filemanagement import new  # noqa: PLC0415

    drawing = new("R2010", units=units.MM)
    drawing.header["$PDMODE"] = _CROSS
    drawing.appids.add(APPLICATION)
    return drawing


def write_drawing(drawing: "Drawing", file: IO[bytes]) -> None:
    """Write a drawing; the file stays open."""
    text = io.TextIOWrapper(file, drawing.output_encoding, "dxfreplace", "\n")
    drawing.write(text)
    text.detach()


def layer_name(text: str, end: str = "") -> str:
    return _NOT_IN_LAYER.sub("_", printable(text))[: _MAX_TEXT - len(end)] + end


def extended_data(**values: str | int | None) -> list[tuple[int, str]]:
    return [
        (_TEXT, printable(f"{name}={value}")[:_MAX_TEXT])
        for name, value in values.items()
        if value not in (None, "")
    ]

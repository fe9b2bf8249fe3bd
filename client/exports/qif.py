"""QIF 3.0 (ISO 23952): documents, and the points of sessions as `Results`.

Lengths are millimetres, angles radians. Numbers keep every digit: coordinates are
xs:double, uncertainties xs:decimal, which has no exponent.
"""

import re
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from itertools import groupby
from math import sqrt
from typing import IO
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from traverse.client.exports.point_table import (
    DIAGONAL,
    Coordinates,
    PointTable,
    Sink,
    place_of,
)
from traverse.client.exports.text import TENSOR, iso_times
from traverse.protocol.messages import Point

NAMESPACE = "http://qifstandards.org/xsd/qif3"
_DECLARATION = '<?xml version="1.0" encoding="UTF-8"?>'
_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_IDENTIFIERS = uuid.uuid5(uuid.NAMESPACE_URL, NAMESPACE)


class QifDocument:
    """A document under construction: header, units, and elements of its root."""

    def __init__(self) -> None:
        self.root = Element("QIFDocument", xmlns=NAMESPACE, versionQIF="3.0.0")
        self._identifier = SubElement(self.root, "QPId")
        header = SubElement(self.root, "Header")
        text_element(SubElement(header, "Application"), "Name", "Traverse")
        units = SubElement(SubElement(self.root, "FileUnits"), "PrimaryUnits")
        angle = SubElement(units, "AngularUnit")
        text_element(angle, "SIUnitName", "radian")
        text_element(angle, "UnitName", "radian")
        length = SubElement(units, "LinearUnit")
        text_element(length, "SIUnitName", "meter")
        text_element(length, "UnitName", "mm")
        text_element(SubElement(length, "UnitConversion"), "Factor", "0.001")
        self._last_id = 0

    def identified(self, parent: Element, name: str) -> Element:
        """Add an element with the next QIF id."""
        self._last_id += 1
        return SubElement(parent, name, id=str(self._last_id))

    def content(self) -> bytes:
        """Return the file; the same values give the same bytes.

        Raises:
            ValueError: A text has a character that XML does not have.
        """
        self.root.set("idMax", str(self._last_id))
        xml = tostring(self.root, encoding="unicode")
        if match := _NOT_XML.search(xml):
            raise ValueError(
                f"a text has the character {match[0]!r}, which XML does not have"
            )
        self._identifier.text = str(uuid.uuid5(_IDENTIFIERS, xml))
        indent(self.root)
        text: str = tostring(self.root, encoding="unicode")
        return f"{_DECLARATION}\n{text}\n".encode()


def text_element(parent: Element, name: str, text: str) -> Element:
    element = SubElement(parent, name)
    element.text = text
    return element


def add_attributes(parent: Element, values: Mapping[str, str | None]) -> None:
    known = {name: value for name, value in values.items() if value is not None}
    attributes = SubElement(parent, "Attributes", n=str(len(known)))
    for name, value in known.items():
        SubElement(attributes, "AttributeStr", name=name, value=value)


def decimal_text(value: float) -> str:
    """Write a number as xs:decimal, with every digit and without an exponent."""
    return format(Decimal(repr(float(value))), "f")


class Qif(Sink):
    """Results of QIF 3.0, a set for each session; held until the end.

    Each point is a PointFeatureMeasurement. Its Location states the standard
    uncertainties of x, y and z; the full covariance is a user-defined attribute.

    Args:
        check: called with the content; raises to refuse it.
    """

    def __init__(
        self,
        file: IO[bytes],
        coordinates: Coordinates = "centre",
        check: Callable[[bytes], None] | None = None,
    ) -> None:
        super().__init__(file, coordinates)
        self._check_content = check
        self._points: list[Point] = []

    def points(self, points: Sequence[Point]) -> None:
        for point in points:
            if point.retracts is not None:
                raise ValueError("QIF holds no retractions; leave out --retracted")
        self._check(points)
        self._points += points
        self.n = len(self._points)

    def table(self, table: PointTable) -> None:
        """Refuse rows of a scan.

        Raises:
            ValueError: Always.
        """
        raise ValueError(f"QIF is written of points, not of {len(table)} rows of scans")

    def end(self) -> None:
        document = QifDocument()
        results = SubElement(document.root, "Results")
        sessions = _sessions(self._points) or [[]]
        every = SubElement(results, "MeasurementResultsSet", n=str(len(sessions)))
        for points in sessions:
            _add_session(document, every, points, self._coordinates)
        content = document.content()
        if self._check_content is not None:
            self._check_content(content)
        self._file.write(content)


def _sessions(points: Iterable[Point]) -> list[list[Point]]:
    """Group by session, arm and model, which are stated once."""
    ordered = sorted(points, key=_group)
    return [list(group) for _, group in groupby(ordered, _group)]


def _group(point: Point) -> tuple[str, str, str]:
    return point.session, point.arm, point.model


def _add_session(
    document: QifDocument,
    parent: Element,
    points: Sequence[Point],
    coordinates: Coordinates,
) -> None:
    results = document.identified(parent, "MeasurementResults")
    if not points:
        _add_status(results, "NOT_MEASURED")
        return
    session, arm, model = _group(points[0])
    stated = {"session": session, "arm": arm, "arm_digest": model}
    add_attributes(results, {**stated, "coordinates": coordinates})
    features = SubElement(results, "MeasuredFeatures", n=str(len(points)))
    times = iso_times([point.time_ns for point in points])
    for point, time_utc in zip(points, times, strict=True):
        _add_point(document, features, point, time_utc, coordinates)
    _add_status(results, "NOT_CALCULATED")


def _add_status(results: Element, status: str) -> None:
    element = SubElement(results, "InspectionStatus")
    text_element(element, "InspectionStatusEnum", status)


def _add_point(
    document: QifDocument,
    parent: Element,
    point: Point,
    time_utc: str,
    coordinates: Coordinates,
) -> None:
    feature = document.identified(parent, "PointFeatureMeasurement")
    label, tensor = point.label, point.covariance_mm2
    if coordinates == "part":
        tensor = None  # it is stated in the arm's system
    add_attributes(
        feature,
        {
            "id": point.id,
            "seq": str(point.seq),
            "ok": str(point.quality.ok).lower(),
            "flags": " ".join(point.quality.flags) or None,
            "artefact": label.artefact,
            "feature": label.feature,
            "ijk": numbers_text(point.ijk),
            "probe_radius_mm": repr(point.probe_radius_mm),
            "compensation": point.compensation,
            f"covariance_mm2 ({' '.join(TENSOR)})": tensor and numbers_text(tensor),
        },
    )
    named = filter(None, (label.artefact, label.feature, str(point.seq)))
    text_element(feature, "FeatureName", " ".join(named))
    text_element(feature, "TimeStamp", time_utc)
    place = text_element(
        feature, "Location", numbers_text(place_of(point, coordinates))
    )
    if tensor is not None:
        for axis, index in zip("xyz", DIAGONAL, strict=True):
            std_mm = sqrt(max(tensor[index], 0.0))
            place.set(f"{axis}CombinedUncertainty", decimal_text(std_mm))


def numbers_text(values: Iterable[float]) -> str:
    """Write xs:double numbers, with every digit."""
    return " ".join(repr(float(value)) for value in values)

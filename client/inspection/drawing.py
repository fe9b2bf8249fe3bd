"""Features of a part as a drawing (DXF), for CAD.

Elements are drawn as far as they were touched. A layer has the name of its feature, one
with a touch in doubt is red; figures with U are extended data (XDATA of TRAVERSE).
"""

import io
from collections.abc import Iterator

import numpy as np

from traverse.arrays import Floats
from traverse.client.exports.dxf import (
    APPLICATION,
    IN_DOUBT,
    RED,
    WHITE,
    extended_data,
    layer_name,
    new_drawing,
    write_drawing,
)
from traverse.client.inspection.sheet import figure_words
from traverse.client.inspection.values import FeatureResult, Inspection
from traverse.kinematics.model.geometry import across

Entity = tuple[str, dict[str, object]]


def dxf_text(inspection: Inspection) -> str:
    """Draw all features that have a place; needs the extra `lab`."""
    drawing = new_drawing()
    space = drawing.modelspace()
    for feature in inspection.features:
        if feature.place_mm is None:
            continue
        in_doubt = any(touch.doubts for touch in feature.touches)
        layer = layer_name(feature.name, f" {IN_DOUBT}" if in_doubt else "")
        if layer not in drawing.layers:
            drawing.layers.add(layer, color=RED if in_doubt else WHITE)
        data = extended_data(
            part=inspection.part,
            serial=inspection.serial,
            system=inspection.system,
            feature=feature.name,
            kind=feature.kind,
            **{f.name: " ".join(figure_words(f)).strip() for f in feature.figures},
        )
        for kind, attributes in _entities(feature):
            entity = space.new_entity(kind, {**attributes, "layer": layer})
            entity.set_xdata(APPLICATION, data)
    text = io.BytesIO()
    write_drawing(drawing, text)
    return text.getvalue().decode()


def _entities(feature: FeatureResult) -> Iterator[Entity]:
    place_mm = np.array(feature.place_mm)
    centres_mm = np.array([touch.centre_mm for touch in feature.touches])
    if feature.direction is None or not len(centres_mm):
        if feature.kind == "sphere":
            yield from (_circle(place_mm, axis, feature) for axis in np.eye(3))
        else:
            yield "POINT", {"location": place_mm.tolist()}
        return
    axis = np.array(feature.direction)
    along_mm = (centres_mm - place_mm) @ axis
    ends_mm = [place_mm + far * axis for far in (along_mm.min(), along_mm.max())]
    match feature.kind:
        case "circle":
            yield _circle(place_mm, axis, feature)
        case "plane":
            yield _rectangle(place_mm, axis, centres_mm)
        case _:  # line, cylinder, cone: as long as it was touched
            yield "LINE", {"start": ends_mm[0].tolist(), "end": ends_mm[1].tolist()}
            if feature.kind == "cylinder":
                yield from (_circle(end_mm, axis, feature) for end_mm in ends_mm)


def _circle(centre_mm: Floats, axis: Floats, feature: FeatureResult) -> Entity:
    from ezdxf.math import OCS  # noqa: PLC0415 - slow, and of an extra

    diameters_mm = [f.value for f in feature.figures if f.name == "diameter"]
    centre = OCS(axis.tolist()).from_wcs(centre_mm.tolist())
    extrusion = {"center": centre, "extrusion": axis.tolist()}
    return "CIRCLE", {**extrusion, "radius": diameters_mm[0] / 2.0}


def _rectangle(place_mm: Floats, normal: Floats, centres_mm: Floats) -> Entity:
    """Return the smallest rectangle in the plane that encloses all touches."""
    first, second = across(normal)
    sides_mm = (centres_mm - place_mm) @ np.stack([first, second], axis=1)
    (low, left), (high, right) = sides_mm.min(axis=0), sides_mm.max(axis=0)
    corners_mm = [
        place_mm + u * first + v * second
        for u, v in ((low, left), (high, left), (high, right), (low, right))
    ]
    names = ("vtx0", "vtx1", "vtx2", "vtx3")
    return "3DFACE", dict(zip(names, (c.tolist() for c in corners_mm), strict=True))

import io

import numpy as np
import pytest
from ezdxf import recover
from ezdxf.math import OCS

from tests.client.inspection.touched import PLAN, touched_points
from traverse.client.inspection.drawing import dxf_text
from traverse.client.inspection.plan import Plan
from traverse.client.inspection.results import inspected
from traverse.protocol.messages import Quality
from traverse.strict_toml.reader import parse_strict


def read_back(inspection):
    drawing, auditor = recover.read(io.BytesIO(dxf_text(inspection).encode()))
    assert not auditor.has_errors
    return drawing.modelspace()


def on_layer(space, name):
    return [entity for entity in space if entity.dxf.layer == name]


def kinds(space, name):
    return [entity.dxftype() for entity in on_layer(space, name)]


@pytest.fixture(scope="module")
def plan():
    return parse_strict(PLAN, "plan", Plan)


def test_each_feature_is_drawn_where_it_was_touched(plan):
    points, truth = touched_points()
    inspection = inspected(plan, points, "no arm file")
    space = read_back(inspection)
    assert kinds(space, "plate") == ["3DFACE"]
    assert kinds(space, "edge") == kinds(space, "cone") == ["LINE"]
    assert kinds(space, "shaft") == ["LINE", "CIRCLE", "CIRCLE"]
    assert kinds(space, "tip") == ["POINT"]
    assert kinds(space, "pitch") == []  # a distance has no place

    (hole,) = on_layer(space, "hole a")
    assert 2 * hole.dxf.radius == pytest.approx(truth["hole a diameter"], abs=0.05)
    # The circle's plane is the plate's, and its centre is that of the touches.
    normal = np.array(hole.dxf.extrusion)
    (plate,) = on_layer(space, "plate")
    corners = np.array([list(plate.dxf.get(f"vtx{n}")) for n in range(4)])
    np.testing.assert_allclose((corners - corners[0]) @ normal, 0.0, atol=1e-9)
    feature = {f.name: f for f in inspection.features}["hole a"]
    centre = np.array(OCS(normal.tolist()).to_wcs(hole.dxf.center))
    np.testing.assert_allclose(centre, feature.place_mm, atol=1e-9)
    touched = np.array([touch.centre_mm for touch in feature.touches])
    inward = hole.dxf.radius - inspection.tip_mm
    reached = np.linalg.norm(np.cross(touched - centre, normal), axis=1)
    np.testing.assert_allclose(reached, inward, atol=0.05)
    texts = [text for _, text in hole.get_xdata("TRAVERSE")]
    assert "part=plate 12" in texts
    assert any(text.startswith("diameter=") for text in texts)
    # The shaft is as long as it was touched.
    axis = on_layer(space, "shaft")[0].dxf
    shaft = {f.name: f for f in inspection.features}["shaft"]
    along = np.array([touch.centre_mm for touch in shaft.touches]) @ shaft.direction
    assert axis.start.distance(axis.end) == pytest.approx(np.ptp(along), abs=1e-9)


def test_what_rests_on_a_doubt_is_on_a_red_layer(plan):
    points, _ = touched_points()
    quality = Quality(ok=False, flags=("skew",))
    doubtful = [
        p.model_copy(update={"quality": quality}) if p.label.feature == "hole b" else p
        for p in points
    ]
    space = read_back(inspected(plan, doubtful, "no arm file"))
    assert kinds(space, "hole b") == []
    assert kinds(space, "hole b in doubt") == ["CIRCLE"]
    assert space.doc.layers.get("hole b in doubt").color == 1


def test_names_that_a_layer_cannot_have_are_replaced(plan):
    (first, *rest) = plan.features
    named = plan.model_copy(
        update={
            "features": (first.model_copy(update={"name": "a/b:1"}), *rest),
            "relations": (),
            "tolerances": (),
        }
    )
    points, _ = touched_points()
    renamed = [
        p.model_copy(update={"label": p.label.model_copy(update={"feature": "a/b:1"})})
        if p.label.feature == first.name
        else p
        for p in points
    ]
    space = read_back(inspected(named, renamed, "no arm file"))
    assert kinds(space, "a_b_1") == ["3DFACE"]

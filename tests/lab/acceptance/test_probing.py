"""Size, form, location on spheres: figures that can be computed by hand."""

import numpy as np
import pytest

from tests.lab.measurements import (
    OCTAHEDRON,
    SURE_MM,
    TIP_MM,
    artefact,
    limits,
    measured,
    of_kind,
    on_a_ball,
    touches,
)
from traverse.lab.acceptance.budget import SMOOTH_FORM, SMOOTH_FORM_OF_ALL
from traverse.lab.acceptance.conformity import Figure, Missing, Scatter
from traverse.lab.acceptance.procedures.probing import (
    effective_diameter,
    location,
    size_and_form,
)
from traverse.simulator.campaigns.acceptance.layout import PATTERN_25, spiral

NAMES = ("probing-1", "probing-2")
FAR = np.array([400.0, 0.0, 0.0])


def even(radii_mm, centre_mm):
    """25 touches: four octahedra of given radii, one more point on the first."""
    places = [
        on_a_ball(centre_mm, radius, OCTAHEDRON) for radius in np.repeat(radii_mm, 2)
    ]
    return np.concatenate([*places, places[0][:1]])


def balls(first, second, **keys):
    entries = []
    for name, places in zip(NAMES, (first, second), strict=True):
        sphere = artefact(name, "sphere", radius_mm=10.0, **keys)
        entries.append((sphere, touches(places, [""] * len(places))))
    return measured(*entries)


def test_size_and_form_by_hand():
    # All points of the first location 4 um too far in: the diameter is 8 um too small.
    data = balls(even([9.996, 9.996], [0, 0, 0]), even([10.003, 10.003], FAR))
    parts = list(size_and_form(data, NAMES, limits()))
    size, form = (of_kind(parts, Figure, key) for key in ("p_size", "p_form"))
    assert size.value_mm == pytest.approx(-0.008, abs=1e-12)
    assert dict(size.parts) == pytest.approx({"probing-1": -0.008, "probing-2": 0.006})
    assert form.value_mm == pytest.approx(0.0, abs=1e-12)
    assert size.decision is None


def test_form_is_the_thickness_of_the_shell():
    # Pairs across at 10.01 and 9.99 along one axis each: centre and shape stay even.
    radii = np.array([10.01, 9.99, 10.0, 10.01, 9.99, 10.0])
    octahedron = (radii + TIP_MM)[:, np.newaxis] * OCTAHEDRON
    bumpy = np.concatenate([*[octahedron] * 4, [[0, 0, 13.0]]])
    good = even([10.0, 10.0], FAR)
    data = balls(bumpy, good)
    parts = list(size_and_form(data, NAMES, limits()))
    form = of_kind(parts, Figure, "p_form")
    (scatter, _) = of_kind(parts, Scatter)
    assert form.value_mm == pytest.approx(np.ptp(scatter.deviations_mm))
    assert form.value_mm == pytest.approx(0.02, abs=1e-9)


def test_expansion_of_the_sphere_is_taken_out():
    sphere = artefact("probing-1", "sphere", radius_mm=10.0, expansion_per_c=1e-4)
    other = artefact("probing-2", "sphere", radius_mm=10.0, expansion_per_c=1e-4)
    grown = 10.0 * (1 + 1e-4 * 5.0)
    data = measured(
        (sphere, touches(even([grown] * 2, [0, 0, 0]), [""] * 25, 25.0)),
        (other, touches(even([grown] * 2, FAR), [""] * 25, 25.0)),
    )
    size = of_kind(size_and_form(data, NAMES, limits()), Figure, "p_size")
    assert size.value_mm == pytest.approx(0.0, abs=1e-12)
    data = measured(
        (sphere, touches(even([grown] * 2, [0, 0, 0]), [""] * 25)),
        (other, touches(even([grown] * 2, FAR), [""] * 25)),
    )
    missing, _ = of_kind(size_and_form(data, NAMES, limits()), Missing)
    assert "temperature_c" in missing.what[0]


def test_budget_of_a_diameter_by_hand():
    data = balls(even([10.0] * 2, [0, 0, 0]), even([10.0] * 2, FAR), radius_std_mm=3e-4)
    standards = {"fixture_std_mm": 8e-4, "form_mm": 1e-3, "form_std_mm": 1e-4}
    parts = list(size_and_form(data, NAMES, limits(standards=standards)))
    size, form = (of_kind(parts, Figure, key) for key in ("p_size", "p_form"))
    *lines, scatter = size.budget.lines
    sizes = {line.name: line.standard_mm for line in lines}
    assert (sizes["calibration"], sizes["fixture"]) == pytest.approx((6e-4, 8e-4))
    # 25 touches deviating each by itself would say 0.14 um; an oval ball says more.
    assert sizes["form of the ball"] == pytest.approx(0.31 * 1e-3)
    assert size.budget.standard_mm == pytest.approx(
        np.hypot(1e-3, sizes["form of the ball"])
    )
    assert (scatter.of_arm, scatter.evaluation, scatter.degrees) == (True, "A", 21)
    expected = np.sqrt(5e-4**2 + 1e-4**2 + 8e-4**2)
    assert form.budget.standard_mm == pytest.approx(expected)


@pytest.mark.parametrize("degree", [2, 3, 4, 6])
def test_the_form_of_smooth_balls_moves_diameters_by_no_more_than_budgets_say(degree):
    rng = np.random.default_rng(degree)
    whole, half = spiral(1500, 180.0), spiral(400, 90.0)
    parts = {25: [], 400: []}
    for _ in range(150):
        ways = rng.standard_normal((8, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        weights = rng.standard_normal(8)

        def heights(places, ways=ways, weights=weights):
            return ((places @ ways.T) ** degree) @ weights

        ball, *_ = np.linalg.lstsq(design(whole), heights(whole))
        form = np.ptp(heights(whole) - design(whole) @ ball)
        for places in (PATTERN_25, half):
            off = heights(places) - design(places) @ ball
            cap, *_ = np.linalg.lstsq(design(places), off)
            parts[len(places)].append(2.0 * cap[3] / form)
    assert np.std(parts[25]) < 1.1 * SMOOTH_FORM
    assert np.std(parts[400]) < 1.1 * SMOOTH_FORM_OF_ALL


def design(outwards):
    """Of the least-squares sphere of distances along these directions."""
    return np.column_stack([outwards, np.ones(len(outwards))])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda places: places[:-2], "2 points are missing of 25"),
        (lambda places: np.concatenate([places, places[:1]]), "take 1 out"),
        (lambda places: places * [1, 1, 0], "one plane"),
    ],
)
def test_what_is_missing_is_said(change, message):
    data = balls(change(even([10.0] * 2, [0, 0, 0])), even([10.0] * 2, FAR))
    parts = list(size_and_form(data, NAMES, limits()))
    assert not of_kind(parts, Figure)
    names = [missing.name for missing in of_kind(parts, Missing)]
    assert names == ["P_SIZE", "P_FORM"]
    assert message in of_kind(parts, Missing)[0].what[0]


def test_one_location_twice_is_remarked():
    data = balls(even([10.0] * 2, [0, 0, 0]), even([10.0] * 2, [1, 0, 0]))
    size = of_kind(size_and_form(data, NAMES, limits()), Figure, "p_size")
    assert "two locations are wanted" in size.remarks[0]


FIVE = np.vstack([OCTAHEDRON[:2], OCTAHEDRON[3:]])
ROOT = np.sqrt(0.75)


@pytest.mark.parametrize(
    ("offsets", "diameter", "supports"),
    [
        # Five centres in one place.
        (np.zeros((5, 3)), 0.0, ""),
        # Two supports: the others lie between; a tie in the middle.
        ([[0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0.9, 0]], 2.0, "A, B"),
        # Three: an equilateral triangle with circumscribed radius 1.
        (
            [[1, 0, 0], [-0.5, ROOT, 0], [-0.5, -ROOT, 0], [0, 0, 0], [0, 0, 0.3]],
            2.0,
            "",
        ),
        # Four: a regular tetrahedron with circumscribed radius sqrt(3).
        ([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0]], 12**0.5, ""),
    ],
)
@pytest.mark.parametrize("radius", ["free", "calibrated"])
def test_location_is_the_diameter_around_five_centres(
    offsets, diameter, supports, radius
):
    um = 1e-3 * np.array(offsets, dtype=float)
    places = [on_a_ball(um[n], 10.0, FIVE) for n in range(5)]
    features = [group for group in "ABCDE" for _ in range(5)]
    sphere = artefact("articulated", "sphere", radius_mm=10.0)
    data = measured((sphere, touches(np.concatenate(places), features)))
    permitted = limits(l_dia_mm=0.005).model_copy(update={"l_dia_radius": radius})
    figure = of_kind(location(data, "articulated", permitted), Figure, "l_dia")
    assert figure.value_mm == pytest.approx(1e-3 * diameter, abs=1e-9)
    assert figure.decision.verdict == "accept"
    assert figure.confirm
    assert supports in figure.definition


def test_location_needs_five_groups_of_five():
    sphere = artefact("articulated", "sphere", radius_mm=10.0)
    places = np.concatenate([on_a_ball([0, 0, 0], 10.0, FIVE)] * 5)
    four = [group for group in "ABCDD" for _ in range(5)]
    (missing,) = location(
        measured((sphere, touches(places, four))), "articulated", limits()
    )
    assert "4 groups (A, B, C, D), expected 5" in missing.what[0]
    uneven = [*(g for g in "ABCD" for _ in range(5)), "E", "E", "E", "E", "A"]
    (missing,) = location(
        measured((sphere, touches(places, uneven))), "articulated", limits()
    )
    assert "group A: 6 points" in missing.what[0]


def test_effective_diameter_is_the_largest_of_three():
    nine = np.vstack([OCTAHEDRON, OCTAHEDRON[:3]])
    sphere = artefact("diameter", "sphere", radius_mm=10.0, radius_std_mm=SURE_MM)
    places = [on_a_ball([0, 0, 0], 10.0 + e, nine) for e in (0.001, -0.004, 0.002)]
    features = [repeat for repeat in "123" for _ in range(9)]
    data = measured((sphere, touches(np.concatenate(places), features)))
    permitted = limits(effective_diameter_mm=0.005)
    (figure,) = effective_diameter(data, "diameter", permitted)
    assert figure.value_mm == pytest.approx(0.008, abs=1e-12)
    errors = {"repeat 1": 0.002, "repeat 2": -0.008, "repeat 3": 0.004}
    assert dict(figure.parts) == pytest.approx(errors)
    assert figure.decision.verdict == "reject"


@pytest.mark.parametrize(
    ("sphere", "message"),
    [
        (artefact("diameter", "sphere"), "radius_mm is missing"),
        (artefact("diameter", "cone"), "is a cone, expected a sphere"),
        (artefact("diameter", "sphere", radius_mm=9.0, side="inside"), "is a ball"),
        (artefact("other", "cone"), "is not among the artefacts"),
    ],
)
def test_the_sphere_must_be_a_calibrated_ball(sphere, message):
    data = measured((sphere, touches(np.ones((1, 3)), [""])))
    (missing,) = effective_diameter(data, "diameter", limits())
    assert message in missing.what[0]

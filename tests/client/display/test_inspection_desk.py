"""The part on the page: its points, and the arm's answers on them."""

import asyncio

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.client.display.values import doubt, live
from tests.client.inspection.touched import ARM, touched_points
from tests.protocol.message_examples import SCAN
from traverse.client.display.arm_state import ArmSight, Change
from traverse.client.display.inspection_desk import MOST_FEATURES, InspectionDesk
from traverse.client.inspection.scan_samples import MOST_SAMPLES, ThinnedScan
from traverse.client.inspection.sheet import sheet_html
from traverse.kinematics.arm_file.arm import read_arm
from traverse.kinematics.helmert.transformation import Helmert
from traverse.lab.measured_points.touch_errors import shared_by_points
from traverse.protocol.messages import Scan


@pytest.fixture
def desk():
    sight = ArmSight(lambda: 0.0)
    sight.live = live(time_ns="1000")
    return InspectionDesk(sight)


def touch(desk, feature):
    """Touch a feature as the demonstration's arm did."""
    points = [p for p in touched_points()[0] if p.label.feature == feature]
    for point in points:
        desk._changed(Change("point", point=point))
    return points


def shares(requests):
    """Answer with common errors of points; record which were requested."""

    async def answer(points):
        requests.append({point.id for point in points})
        factors = shared_by_points(points, ARM, read_arm(ARM))
        return {point.id: f for point, f in zip(points, factors, strict=True)}

    return answer


def test_points_are_asked_for_once_and_results_follow(desk):
    requests = []
    share = shares(requests)
    desk.begin("plane")
    plate = touch(desk, "plate")
    assert asyncio.run(desk.measure(share))
    assert not asyncio.run(desk.measure(share))
    desk.accept()
    name = desk.begin("circle")
    assert desk.features[name].plane == "plane 1"
    bore = touch(desk, "hole a")
    asyncio.run(desk.measure(share))
    assert requests == [{p.id for p in plate}, {p.id for p in bore}]
    figures = {figure.name: figure for figure in desk.result(name).figures}
    assert figures["diameter"].expanded < 0.05


def scan_of(feature, numbers, **changes):
    """A block of a scan at the places of a feature's touches, over and over."""
    points = [p for p in touched_points()[0] if p.label.feature == feature]
    rows = [points[number % len(points)] for number in numbers]
    n = len(rows)
    fields = {
        **dict(SCAN),
        "seq": numbers[0],
        "model": rows[0].model,
        "probe_radius_mm": rows[0].probe_radius_mm,
        "dtime_ns": np.arange(n) * 1_000_000,
        "xyz_mm": np.array([p.xyz_mm for p in rows]),
        "ijk": np.array([p.ijk for p in rows]),
        "angles_rad": np.array([p.angles_rad for p in rows]),
        "counts": None,
        "covariance_mm2": np.array([p.covariance_mm2 for p in rows]),
        "quality": np.zeros(n, np.uint32),
        "last": False,
        "total": None,
        **changes,
    }
    del fields["schema_"]
    return Scan(**fields)


def test_samples_of_a_scan_belong_to_the_active_feature_once_it_ends(desk):
    desk._sight.take_scan(scan_of("plate", range(9)))  # of no feature
    name = desk.begin("plane")
    doubtful = np.array([1 << 5, 0, 0], np.uint32)
    desk._sight.take_scan(scan_of("plate", range(40, 43), quality=doubtful))
    desk._sight.take_scan(scan_of("plate", range(45, 60)))
    assert desk.scanned.part.words == (
        "scan scan-3: 6 of 18 samples, 2 lost, 1 in doubt"
    )
    assert desk.features[name].points == []
    desk._sight.take_scan(scan_of("plate", range(60, 62), last=True, total=62))
    assert desk.scanned is None
    asyncio.run(desk.measure(shares([])))
    (part,) = desk.result(name).scans
    assert (part.used, part.samples, part.lost, part.in_doubt) == (6, 20, 2, 1)
    assert [touch.doubts for touch in desk.result(name).touches[:2]] == [
        ("overspeed",),
        (),
    ]
    assert desk.touches_of(name) == 0
    figures = {figure.name: figure for figure in desk.result(name).figures}
    assert 0.0 < figures["form"].expanded < 0.1
    for touch in desk.result(name).touches:
        desk.assign(touch.id, None)
    asyncio.run(desk.measure(shares([])))
    assert desk.result(name).scans == ()


def test_an_accepted_feature_keeps_the_samples_so_far_and_a_new_part_none(desk):
    hole = desk.begin("circle")
    desk._sight.take_scan(scan_of("hole a", range(30)))
    desk.accept()
    asyncio.run(desk.measure(shares([])))
    assert "from inside or from outside is not known" in desk.result(hole).problem
    desk.features[hole].side = "inside"
    desk.version += 1
    asyncio.run(desk.measure(shares([])))
    figures = {figure.name: figure for figure in desk.result(hole).figures}
    truth_mm = touched_points()[1]["hole a diameter"]
    off_mm = abs(figures["diameter"].value - truth_mm)
    assert off_mm <= figures["diameter"].expanded < 0.1
    sheet = sheet_html(desk.inspection)
    assert "scan scan-3: 8 of 30 samples" in sheet
    desk.touch(hole)
    desk._sight.take_scan(scan_of("hole a", range(30, 60)))
    desk.clear()
    assert desk.scanned is None


def test_a_long_scan_is_thinned_evenly():
    turns = np.linspace(0.0, 40.0 * np.pi, 12_000)
    helix_mm = np.column_stack([30 * np.cos(turns), 30 * np.sin(turns), turns])
    thinned = ThinnedScan(SCAN.session, SCAN.scan)
    for start in range(0, 12_000, 500):
        n = range(start, start + 500)
        thinned.add(scan_of("shaft", n, xyz_mm=helix_mm[start : start + 500]))
    samples = thinned.samples()
    assert 100 < len(samples) <= MOST_SAMPLES
    assert len({sample.id for sample in samples}) == len(samples)
    assert [s.seq for s in samples] == sorted(s.seq for s in samples)
    heights_mm = np.array([sample.xyz_mm[2] for sample in samples])
    in_thirds, _ = np.histogram(heights_mm, bins=3)
    assert in_thirds.min() > 0.2 * len(samples)


def test_what_the_arm_refuses_is_the_reason_for_no_uncertainty(desk):
    async def refused(_):
        return "it was never identified"

    desk.begin("plane")
    touch(desk, "plate")
    asyncio.run(desk.measure(refused))
    assert desk.inspection.uncertainty_unknown == "it was never identified"
    assert desk.result("plane 1").figures[0].expanded is None


def test_what_rests_on_a_removed_feature_goes_with_it(desk):
    for feature in ("hole a", "hole b"):
        desk.begin("circle")
        touch(desk, feature)
    desk.accept()
    middle = desk.relate("symmetry", ("circle 1", "circle 2"))
    height = desk.relate("distance", (middle, "circle 1"))
    assert [*desk.relations] == [middle, height]
    desk.remove("circle 2")
    assert desk.relations == {}
    assert [*desk.features] == ["circle 1"]


def test_retracted_points_and_those_of_before_do_not_count(desk):
    desk._sight.live = live(time_ns=str(touched_points()[0][0].time_ns + 1))
    desk.begin("plane")
    touch(desk, "plate")
    assert desk.features["plane 1"].points == []
    desk._begun_ns = 0
    first, *_ = touch(desk, "plate")
    back = first.retraction(
        seq=99, point_id="back", trigger="button", time_ns=first.time_ns + 1
    )
    desk._changed(Change("retraction", point=back))
    assert first.id not in desk.features["plane 1"].points
    assert len(desk.features["plane 1"].points) == 5


def test_a_part_has_a_bound(desk):
    for _ in range(MOST_FEATURES):
        desk.begin("plane")
    with pytest.raises(ValueError, match="at most 200 features"):
        desk.begin("plane")


def test_a_plane_an_edge_and_a_bore_make_the_parts_system(desk):
    for kind, feature in (
        *(("plane", "plate"), ("line", "edge"), ("circle", "hole a")),
        ("circle", "hole b"),
    ):
        desk.begin(kind)
        touch(desk, feature)
    system = desk.align(("plane 1", "line 1", "circle 1"))
    assert np.linalg.det(system.rotation) == pytest.approx(1.0)
    asyncio.run(desk.measure(shares([])))
    assert desk.inspection.system == "part"
    places = {
        name: [figure.value for figure in desk.result(name).figures[:3]]
        for name in ("circle 1", "circle 2")
    }
    np.testing.assert_allclose(places["circle 1"], [0.0, 20.0, 0.0], atol=0.05)
    _, truth = touched_points()
    apart_mm = np.subtract(places["circle 2"], places["circle 1"])
    length_mm = np.linalg.norm(apart_mm)
    assert length_mm == pytest.approx(truth["hole a to hole b"], abs=0.05)
    with pytest.raises(ValueError, match="3-2-1 needs a plane"):
        desk.align(("line 1", "line 1", "circle 1"))


def test_bores_and_an_apex_are_fitted_onto_their_nominal_places(desk):
    """The truth of the part is in the arm's system: the fit is near the identity."""
    _, truth = touched_points()
    for kind, feature in (
        *(("plane", "plate"), ("circle", "hole a"), ("circle", "hole b")),
        ("cone", "cone"),
    ):
        desk.begin(kind)
        touch(desk, feature)
    desk.accept()
    desk.relate("apex", ("cone 1",))
    share = shares([])
    asyncio.run(desk.measure(share))
    assert [name for name in (*desk.features, *desk.relations) if desk.has_place(name)]
    at_mm = [truth[f"hole a {axis}"] for axis in "xyz"]
    nominals_mm = {
        "circle 1": at_mm,
        "circle 2": [truth[f"hole b {axis}"] for axis in "xyz"],
        "apex 1": [at_mm[0] + 25.0, at_mm[1], at_mm[2] + 70.0],
    }
    fit = desk.fit(nominals_mm)
    assert np.abs(fit.system.rotation - np.eye(3)).max() < 0.005
    assert fit.redundancy == 3
    assert fit.sigma0 < 2.0
    assert desk.alignment is None
    desk.align_to(fit.system)
    asyncio.run(desk.measure(share))
    apex = [figure.value for figure in desk.result("apex 1").figures[:3]]
    off_mm = np.subtract(nominals_mm["apex 1"], apex)
    np.testing.assert_allclose(off_mm, fit.residuals_mm["apex 1"], atol=1e-9)


def moved_touches(feature, system):
    """Touch a feature from a station that `system` leads to the first one from."""
    back = system.inverse()
    points = [p for p in touched_points()[0] if p.label.feature == feature]
    places_mm = back.places_mm(np.array([p.xyz_mm for p in points]))
    surfaces_mm = back.places_mm(np.array([p.surface_mm for p in points]))
    return [
        p.model_copy(
            update={
                "id": f"{p.id} again",
                "xyz_mm": tuple(place_mm),
                "surface_mm": tuple(surface_mm),
                "ijk": tuple(back.rotation @ p.ijk),
            }
        )
        for p, place_mm, surface_mm in zip(
            points, places_mm.tolist(), surfaces_mm.tolist(), strict=True
        )
    ]


def test_after_the_arm_was_moved_results_go_on_in_the_first_system(desk):
    async def refused(_):
        return "never identified"

    touched = (("plane", "plate"), ("circle", "hole a"), ("circle", "hole b"))
    for kind, feature in touched:
        desk.begin(kind)
        touch(desk, feature)
    for row in (0, 3):
        desk.begin("point")
        corner = [p for p in touched_points()[0] if p.label.feature == "edge"][row]
        desk._changed(Change("point", point=corner))
    desk.accept()
    asyncio.run(desk.measure(refused))
    before = {name: desk.result(name).place_mm for name in desk.features}
    desk.begin_leapfrog()
    assert [*desk.stations.again.values()] == [*desk.features][:5]
    with pytest.raises(ValueError, match="the arm was moved"):
        desk.begin("sphere")
    with pytest.raises(ValueError, match="the arm was moved"):
        desk.touch("circle 1")
    turn = Rotation.from_euler("xyz", [0.1, -0.2, 2.0]).as_matrix()
    system = Helmert(turn, np.array([400.0, -100.0, 20.0]))
    edge = moved_touches("edge", system)
    again = [moved_touches(feature, system) for _, feature in touched]
    for name, points in zip(
        desk.stations.again, [*again, [edge[0]], [edge[3]]], strict=True
    ):
        desk.touch(name)
        for point in points:
            desk._changed(Change("point", point=point))
    asyncio.run(desk.measure(refused))
    unjoined = desk.result("circle 1 again 1")
    assert "not joined yet" in unjoined.problem
    assert unjoined.place_mm is None
    fit = desk.fit_leapfrog()
    np.testing.assert_allclose(fit.system.rotation, turn, atol=1e-9)
    sent = desk.end_leapfrog(fit)
    np.testing.assert_allclose(sent.translation_mm, [400, -100, 20], atol=1e-6)
    asyncio.run(desk.measure(refused))
    for name, place_mm in before.items():
        place_again_mm = desk.result(f"{name} again 1").place_mm
        np.testing.assert_allclose(place_again_mm, place_mm, atol=1e-6)
    desk.begin("cone")
    for point in moved_touches("cone", system):
        desk._changed(Change("point", point=point))
    asyncio.run(desk.measure(refused))
    _, truth = touched_points()
    apex_mm = desk.result("cone 1").place_mm
    assert abs(apex_mm[0] - truth["hole a x"]) < 100.0
    # A touch that says where the arm stands turns out to be in doubt.
    of_before = desk.result("circle 1").touches[0].id
    desk._take_doubt(doubt(points=of_before))
    asyncio.run(desk.measure(refused))
    assert {touch.doubts for touch in desk.result("cone 1").touches} == {("stale",)}
    of_circle = desk.result("circle 2").touches
    assert {touch.doubts for touch in of_circle} == {()}


def test_an_arm_that_was_not_moved_after_all_is_as_before(desk):
    with pytest.raises(ValueError, match="three features that have a place"):
        desk.begin_leapfrog()
    for row in range(3):
        desk.begin("point")
        corner = [p for p in touched_points()[0] if p.label.feature == "plate"][row]
        desk._changed(Change("point", point=corner))
    desk.accept()
    asyncio.run(desk.measure(shares([])))
    desk.begin_leapfrog()
    desk.touch(next(iter(desk.stations.again)))
    desk.accept()
    assert len(desk.features) == 6
    with pytest.raises(ValueError, match="no feature has a place"):
        desk.fit_leapfrog()
    assert desk.end_leapfrog(None) is None
    assert [*desk.features] == ["point 1", "point 2", "point 3"]
    desk.begin("sphere")

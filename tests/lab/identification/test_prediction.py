"""Poses that took no part, against an arm: places from others, or from themselves."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.simulated import (
    DESIGN_ARM,
    Noise,
    arm_value,
    bar,
    built,
    cones,
    simulate,
)
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.identification.prediction import placed, places_of, predict

GRID = {"A": [0.0, 0, 0], "B": [90.0, 0, 0], "C": [0.0, 80, 0], "D": [10.0, 20, 70]}
TABLES = [
    *cones(1),
    bar(),
    {"id": "gauge", "kind": "seats", "distance_mm": 50.0},
    {"id": "grid", "kind": "points", "frame": "own", "points_mm": GRID},
]
NONE = Noise(0.0, 0.0)
TRUE = built(3)


@pytest.fixture(scope="module")
def exact():
    """Without any noise."""
    return simulate(TRUE, TABLES, 24, seed=4, noise=NONE, travel_rad=2.5)


def halves(campaign):
    first = np.arange(len(campaign.poses)) % 24 < 14
    return campaign.part(first), campaign.part(~first)


def test_the_true_arm_predicts_exact_poses_with_the_places_of_others(exact):
    fitted, judged = halves(exact)
    places = places_of(placed(fitted, arm_value(TRUE)))
    found = predict(judged, arm_value(TRUE), places)
    assert found.placed_by_itself == frozenset()
    assert len(found.distances_mm) == 40
    assert found.distances_mm.max() < 1e-6


def test_another_arm_is_off_by_what_its_centres_are_off_from_the_places(exact):
    fitted, judged = halves(exact)
    design = DESIGN_ARM
    places = places_of(placed(fitted, design))
    found = predict(judged, design, places)
    seat = judged.poses.artefacts == 0
    geometry = geometry_from_arm(design)
    centres_mm = probe_centre(geometry, judged.poses.angles_rad[seat])
    expected = np.linalg.norm(centres_mm - places["cone-0"], axis=1)
    assert found.distances_mm[seat] == pytest.approx(expected)
    figures = found.by_artefact()["cone-0"]
    assert figures["n"] == 10
    assert figures["mean_mm"] == pytest.approx(expected.mean())
    assert figures["rms_mm"] == pytest.approx(np.sqrt(np.mean(expected**2)))
    assert figures["largest_line"] == judged.poses.lines[seat][np.argmax(expected)]


def test_an_artefact_that_nobody_placed_is_placed_by_its_own_poses(exact):
    fitted, judged = halves(exact)
    places = dict(places_of(placed(fitted, arm_value(TRUE))))
    del places["grid"]
    found = predict(judged, arm_value(TRUE), places)
    assert found.placed_by_itself == {"grid"}
    assert found.by_artefact()["grid"]["placed_by"] == "itself"
    assert found.distances_mm.max() < 1e-6


def test_points_of_other_names_are_in_the_same_frame(exact):
    """A tracker's points are named by their rows, in every table anew."""
    fitted, judged = halves(exact)
    grid = judged.artefacts[3]
    renamed = {f"row {k}": at for k, at in enumerate(grid.points_mm.values())}
    judged = replace(
        judged,
        artefacts=(
            *judged.artefacts[:3],
            grid.model_copy(update={"points_mm": renamed}),
        ),
        feature_names=(*judged.feature_names[:3], tuple(renamed)),
    )
    places = places_of(placed(fitted, arm_value(TRUE)))
    assert predict(judged, arm_value(TRUE), places).distances_mm.max() < 1e-6


def test_the_tool_is_found_where_it_is_requested(exact):
    arm = arm_value(TRUE)
    vector_mm = (0.3, -0.2, 0.5)
    other = arm.model_copy(
        update={"probe": arm.probe.model_copy(update={"vector_mm": vector_mm})}
    )
    found = placed(exact, other, with_tool=True)
    assert np.allclose(found.arm.probe.vector_mm, 0.0, atol=1e-6)
    for joint, given in zip(found.arm.joints, arm.joints, strict=True):
        assert joint.link_mm == pytest.approx(given.link_mm, abs=1e-12)
    assert predict(exact, found.arm, {}).distances_mm.max() < 1e-6
    assert predict(exact, other, {}).distances_mm.max() > 0.1


def test_blunders_count_and_are_named_by_their_line(exact):
    fitted, judged = halves(exact)
    places = places_of(placed(fitted, arm_value(TRUE)))
    poses = judged.poses
    angles_rad = poses.angles_rad.copy()
    angles_rad[7, 1] += 0.01
    spoilt = replace(judged, poses=replace(poses, angles_rad=angles_rad))
    figures = predict(spoilt, arm_value(TRUE), places).figures()
    assert figures["n"] == 40
    assert figures["largest_line"] == poses.lines[7]
    assert figures["largest_mm"] > 1.0


def test_places_are_where_the_artefacts_stand(exact):
    found = {
        entry.id: entry.place for entry in placed(exact, arm_value(TRUE)).artefacts
    }
    centres_mm = TRUE.centres(exact.poses.angles_rad)
    at = exact.poses.artefacts
    assert found["cone-0"]["point_mm"] == pytest.approx(centres_mm[at == 0][0])
    ends_mm = np.array(found["bar"]["centres_mm"])
    assert np.linalg.norm(ends_mm[1] - ends_mm[0]) == pytest.approx(400.0)
    seats_mm = found["gauge"]["points_mm"]
    for feature, name in enumerate(("1", "2")):
        mine = (at == 2) & (exact.poses.features == feature)
        assert seats_mm[name] == pytest.approx(centres_mm[mine][0])
    frame = found["grid"]
    known_mm = np.array(list(GRID.values()))[exact.poses.features[at == 3]]
    placed_mm = known_mm @ np.array(frame["rotation"]).T + frame["translation_mm"]
    assert placed_mm == pytest.approx(centres_mm[at == 3])
    assert frame["scale"] == 1.0


def test_surfaces_have_places_in_the_arm_s_system():
    tables = [
        {"id": "plate", "kind": "plane"},
        {"id": "gauge", "kind": "parallel_planes", "distance_mm": 60.0},
        {"id": "ball", "kind": "sphere", "radius_mm": 20.0},
    ]
    campaign = simulate(TRUE, tables, 24, seed=5, noise=NONE, travel_rad=2.5)
    found = {e.id: e.place for e in placed(campaign, arm_value(TRUE)).artefacts}
    centres_mm = TRUE.centres(campaign.poses.angles_rad)
    at = campaign.poses.artefacts
    plane = found["plate"]
    heights_mm = centres_mm[at == 0] @ plane["normal"] - plane["offset_mm"]
    assert np.abs(heights_mm) == pytest.approx(3.0)
    pair = found["gauge"]
    assert np.diff(pair["offsets_mm"]) == pytest.approx(60.0)
    for feature, offset_mm in enumerate(pair["offsets_mm"]):
        mine = (at == 1) & (campaign.poses.features == feature)
        assert np.abs(centres_mm[mine] @ pair["normal"] - offset_mm) == pytest.approx(
            3.0
        )
    away_mm = centres_mm[at == 2] - found["ball"]["centre_mm"]
    assert np.linalg.norm(away_mm, axis=1) == pytest.approx(23.0)

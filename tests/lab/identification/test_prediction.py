"""Poses that took no part, against an arm: places from others, or from themselves.

Poses kept aside: no worse than plain least squares predicts them.

Arms that are far from their design and measured little, and arms that do something
their model lacks. The plain way is scipy's, with matrices and parameters of its own.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.lab.identification.words import said
from tests.lab.simulated import (
    DESIGN_ARM,
    Noise,
    TrueArm,
    arm_value,
    bar,
    built,
    cones,
    seen_places,
    seven_joints,
    simulate,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.prediction import (
    WORDS as PREDICTION_WORDS,
)
from traverse.lab.identification.prediction import (
    curve_figures,
    placed,
    places_of,
    predict,
    predicted,
)

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


def with_curve(arm, joint, knots, values_rad):
    curve = {
        "kind": "empirical",
        "joint": joint,
        "covariate": f"{joint}_rad",
        "knots": knots,
        "values_rad": values_rad,
    }
    return Arm.model_validate({**arm.model_dump(by_alias=True), "effects": (curve,)})


@pytest.mark.parametrize("error_rad", [1e-3, 0.0])
def test_a_curve_is_compared_with_the_arm_without_it(exact, error_rad):
    fitted, judged = halves(exact)
    knots, values_rad = (-0.4, 0.0, 0.5), (0.0, error_rad, -error_rad)
    arm = with_curve(arm_value(TRUE), "J3", knots, values_rad)
    figures = curve_figures(judged, arm, fitted, with_tool=False)
    read_rad = judged.poses.angles_rad[:, judged.joint_names.index("J3")]
    n_beyond = np.count_nonzero((read_rad < -0.4) | (read_rad > 0.5))
    assert 0 < figures["n_beyond_knots"] == n_beyond < len(read_rad)
    assert figures["without"]["largest_mm"] < 1e-6
    _, result = predicted(judged, arm, fitted, with_tool=False)
    values = {
        **{"campaign": "c", "arm": "a", "fit_on": "f", "probe_vector_mm": None},
        "distance_mm": result.figures(),
        "artefacts": result.by_artefact(),
        "curves": figures,
    }
    words = " ".join(PREDICTION_WORDS.lines("prediction", values, None))
    assert f"{n_beyond} of {len(read_rad)} poses lie beyond" in words
    worse = "The curves make the mean and the largest worse"
    assert (worse in words) == (error_rad > 0.0)


def test_an_arm_without_curves_is_compared_with_nothing(exact):
    assert curve_figures(exact, arm_value(TRUE), with_tool=False) is None


def halves(campaign):
    first = np.arange(len(campaign.poses)) % 24 < 14
    return campaign.part(first), campaign.part(~first)


def test_the_true_arm_predicts_exact_poses_with_the_places_of_others(exact):
    fitted, judged = halves(exact)
    places = places_of(placed(fitted, arm_value(TRUE)))
    prediction = predict(judged, arm_value(TRUE), places)
    assert prediction.placed_by_itself == frozenset()
    assert len(prediction.distances_mm) == 40
    assert prediction.distances_mm.max() < 1e-6


def test_another_arm_is_off_by_what_its_centres_are_off_from_the_places(exact):
    fitted, judged = halves(exact)
    design = DESIGN_ARM
    places = places_of(placed(fitted, design))
    prediction = predict(judged, design, places)
    seat = judged.poses.artefacts == 0
    geometry = geometry_from_arm(design)
    centres_mm = probe_centre(geometry, judged.poses.angles_rad[seat])
    expected = np.linalg.norm(centres_mm - places["cone-0"], axis=1)
    assert prediction.distances_mm[seat] == pytest.approx(expected)
    figures = prediction.by_artefact()["cone-0"]
    assert figures["n"] == 10
    assert figures["mean_mm"] == pytest.approx(expected.mean())
    assert figures["rms_mm"] == pytest.approx(np.sqrt(np.mean(expected**2)))
    assert figures["largest_line"] == judged.poses.lines[seat][np.argmax(expected)]


def test_an_artefact_that_nobody_placed_is_placed_by_its_own_poses(exact):
    fitted, judged = halves(exact)
    places = dict(places_of(placed(fitted, arm_value(TRUE))))
    del places["grid"]
    prediction = predict(judged, arm_value(TRUE), places)
    assert prediction.placed_by_itself == {"grid"}
    assert prediction.by_artefact()["grid"]["placed_by"] == "itself"
    assert prediction.distances_mm.max() < 1e-6


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
    with_tool = placed(exact, other, with_tool=True).arm
    assert np.allclose(with_tool.probe.vector_mm, 0.0, atol=1e-6)
    for joint, designed in zip(with_tool.joints, arm.joints, strict=True):
        assert joint.link_mm == pytest.approx(designed.link_mm, abs=1e-12)
    assert predict(exact, with_tool, {}).distances_mm.max() < 1e-6
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
    places = {
        entry.id: entry.place for entry in placed(exact, arm_value(TRUE)).artefacts
    }
    centres_mm = TRUE.centres(exact.poses.angles_rad)
    at = exact.poses.artefacts
    assert places["cone-0"]["point_mm"] == pytest.approx(centres_mm[at == 0][0])
    ends_mm = np.array(places["bar"]["centres_mm"])
    assert np.linalg.norm(ends_mm[1] - ends_mm[0]) == pytest.approx(400.0)
    seats_mm = places["gauge"]["points_mm"]
    for feature, name in enumerate(("1", "2")):
        mine = (at == 2) & (exact.poses.features == feature)
        assert seats_mm[name] == pytest.approx(centres_mm[mine][0])
    frame = places["grid"]
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
    places = {e.id: e.place for e in placed(campaign, arm_value(TRUE)).artefacts}
    centres_mm = TRUE.centres(campaign.poses.angles_rad)
    at = campaign.poses.artefacts
    plane = places["plate"]
    heights_mm = centres_mm[at == 0] @ plane["normal"] - plane["offset_mm"]
    assert np.abs(heights_mm) == pytest.approx(3.0)
    pair = places["gauge"]
    assert np.diff(pair["offsets_mm"]) == pytest.approx(60.0)
    for feature, offset_mm in enumerate(pair["offsets_mm"]):
        mine = (at == 1) & (campaign.poses.features == feature)
        assert np.abs(centres_mm[mine] @ pair["normal"] - offset_mm) == pytest.approx(
            3.0
        )
    away_mm = centres_mm[at == 2] - places["ball"]["centre_mm"]
    assert np.linalg.norm(away_mm, axis=1) == pytest.approx(23.0)


DESIGN = seven_joints()
QUICK = Options(n_suggestions=0)
N_JUDGES = 150


def seen_by_a_tracker(true, n_poses, seed, *, travel_rad, noise, fault=None):
    """Readings and places of the ball; `fault` changes the true angles."""
    rng = np.random.default_rng([seed, n_poses])
    turns = rng.uniform(-1.0, 1.0, (n_poses + N_JUDGES, 7)) * travel_rad
    encoder_rad, contact_mm = noise
    truly = true.zeros_rad + turns + rng.normal(size=turns.shape) * encoder_rad
    if fault is not None:
        fault(turns, truly)
    places_mm = true.centres(truly) + rng.normal(size=(len(turns), 3)) * contact_mm
    return true.zeros_rad + turns, places_mm


def ours(angles_rad, places_mm, options=QUICK, true_mm=None):
    """The result, and rms distance of the judges [mm]; by true_mm they are placed."""
    used = slice(0, len(angles_rad) - N_JUDGES)
    campaign = seen_places(angles_rad[used], places_mm[used])
    result = identify(campaign, DESIGN_ARM, options)
    judges = seen_places(angles_rad[used.stop :], places_mm[used.stop :])
    if true_mm is not None:
        campaign = seen_places(angles_rad[used], true_mm[used])
    prediction = predict(judges, result.arm, places_of(placed(campaign, result.arm)))
    return result, float(np.sqrt(np.mean(prediction.distances_mm**2)))


def onto(seen_mm, at_mm):
    """The rigid motion of seen places onto those of the arm (Kabsch 1976)."""
    middle, centre = seen_mm.mean(axis=0), at_mm.mean(axis=0)
    u, _, v = np.linalg.svd((seen_mm - middle).T @ (at_mm - centre))
    turn = (u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v).T
    return lambda places: (places - middle) @ turn.T + centre


def plainly(angles_rad, places_mm):
    """The same by least squares over all axes and links, equal weights."""
    used = slice(0, len(angles_rad) - N_JUDGES)
    n = len(DESIGN.axes)

    def made(x):
        axes = DESIGN.axes + x[: 3 * n].reshape(n, 3)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        links_mm = DESIGN.links_mm + x[3 * n :].reshape(n, 3)
        return TrueArm(axes, links_mm, DESIGN.zeros_rad, DESIGN.origin_mm)

    def misclosures(x):
        at = made(x).centres(angles_rad[used])
        return np.ravel(at - onto(places_mm[used], at)(places_mm[used]))

    scale = np.r_[np.full(3 * n, 0.01), np.full(3 * n, 10.0)]
    arm = made(least_squares(misclosures, np.zeros(6 * n), x_scale=scale).x)
    frame = onto(places_mm[used], arm.centres(angles_rad[used]))
    off = arm.centres(angles_rad[used.stop :]) - frame(places_mm[used.stop :])
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("link_mm", "axis_rad", "most"),
    [
        # Far from its design: what the design says of weak directions is worth little.
        (20.0, 0.1, 1.15),
        # Close to it: plain least squares does not use that.
        (1.0, 0.005, 0.9),
    ],
)
def test_few_poses_of_an_arm_far_from_its_design(link_mm, axis_rad, most):
    mine, plain = [], []
    for seed in range(2):
        true = built(seed, link_mm, axis_rad)
        data = seen_by_a_tracker(true, 15, seed, travel_rad=0.7, noise=(1e-3, 1.0))
        mine.append(ours(*data)[1])
        plain.append(plainly(*data))
    assert np.mean(mine) < most * np.mean(plain)


def local(joint, size_rad, width_rad):
    """A joint that reads wrong in a part of its range."""

    def fault(turns, truly):
        truly[np.abs(turns[:, joint] - 0.4) < width_rad, joint] += size_rad

    return fault


@pytest.mark.parametrize(("seed", "n_blunders"), [(0, 0), (1, 3)])
def test_excluded_poses_that_lie_together_are_a_finding_of_the_model(seed, n_blunders):
    angles_rad, places_mm = seen_by_a_tracker(
        built(seed),
        80,
        seed,
        travel_rad=1.5,
        noise=(3e-5, 0.02),
        fault=local(3, 2e-3, 0.3),
    )
    away = np.flatnonzero(angles_rad[:80, 3] - DESIGN.zeros_rad[3] < -0.5)[:n_blunders]
    clean_mm = places_mm.copy()
    places_mm[away] += [6.0, -8.0, 5.0]
    result, rms_mm = ours(angles_rad, places_mm, true_mm=clean_mm)
    (excluded,) = result.clusters
    assert excluded.taken_back
    assert excluded.cluster.joint == "J4"
    zero_rad = DESIGN.zeros_rad[3]
    assert (
        zero_rad + 0.05 < excluded.cluster.low < excluded.cluster.high < zero_rad + 0.75
    )
    assert np.isin(away, np.flatnonzero(~result.included)).all()
    words = said(result)
    assert "where joint J4 is at" in words
    assert "They take part" in words
    everything = ours(angles_rad, clean_mm, replace(QUICK, snooping=False))[1]
    assert rms_mm < 1.03 * everything


def test_blunders_that_lie_together_by_chance_stay_out():
    angles_rad, places_mm = seen_by_a_tracker(
        built(2), 300, 2, travel_rad=1.5, noise=(3e-5, 0.02)
    )
    by_angle = np.argsort(angles_rad[:300, 1])
    wrong = by_angle[[100, 102, 103, 106]]
    towards = [[0.9, 0.0, -0.4], [-0.3, 0.8, 0.5], [0.1, -0.9, 0.6], [-0.7, 0.4, -0.7]]
    places_mm[wrong] += towards
    result, _ = ours(angles_rad, places_mm)
    assert np.flatnonzero(~result.included).tolist() == sorted(wrong)
    (excluded,) = result.clusters
    assert (excluded.cluster.joint, excluded.taken_back) == ("J2", False)
    words = said(result)
    assert "the arm may do something there" in words
    assert "They were left out" in words


def test_excluded_poses_of_one_time_stay_out_and_are_reported():
    angles_rad, places_mm = seen_by_a_tracker(
        built(1), 80, 1, travel_rad=1.5, noise=(3e-5, 0.02)
    )
    true_mm = places_mm.copy()
    places_mm[50:62] += [0.7, 0.0, -0.4]
    result, rms_mm = ours(angles_rad, places_mm, true_mm=true_mm)
    assert np.flatnonzero(~result.included).tolist() == list(range(50, 62))
    (excluded,) = result.clusters
    assert (excluded.cluster.covariate, excluded.taken_back) == ("time_s", False)
    words = said(result)
    assert "12 poses that contradict the others lie together, among 12" in words
    assert "between 50 and 61 s of the campaign's time" in words
    assert rms_mm < 0.1

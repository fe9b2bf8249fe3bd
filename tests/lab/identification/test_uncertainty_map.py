"""The volumetric uncertainty: by hand, by drawing arms at random, for any datum.

Arms compared at the probe: placing does not count, geometry does.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.lab.simulated import (
    TrueArm,
    arm_value,
    bar,
    cones,
    disturbed,
    in_another_posture,
    rotations,
    seven_joints,
    simulate,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment import Adjustment, ArmValues, Problem, adjust
from traverse.lab.adjustment.datum import with_datum
from traverse.lab.adjustment.prepare import arm_parameters
from traverse.lab.campaign.poses import Poses
from traverse.lab.identification.results.arm_comparison import (
    ComparisonError,
    compare_arms,
)
from traverse.lab.identification.uncertainty_map import (
    ArmUncertainty,
    arm_uncertainty,
    distance_deviations_mm,
    nearest_samples,
    postures_reaching,
    sample_postures,
    uncertainty_map,
)

TRUE = seven_joints()


def one_joint(length_mm: float) -> Geometry:
    """A hand of a clock."""
    return Geometry(
        np.zeros(3),
        np.array([[0.0, 0.0, 1.0]]),
        np.array([[length_mm, 0.0, 0.0]]),
        np.zeros(1),
        np.zeros(3),
        np.array([1.0, 0.0, 0.0]),
    )


@cache
def adjusted(datum: tuple[str, ...]) -> Adjustment:
    """An adjusted campaign, with its datum among some parameters."""
    campaign = simulate(disturbed(TRUE, 3), [*cones(4), bar()], 40, 7)
    geometry = TRUE.geometry()
    parameters = arm_parameters(geometry, campaign.joint_names)
    among = np.array([name.startswith((*datum, "origin")) for name in parameters.names])
    with_held = with_datum(parameters, geometry, among)
    design = ArmValues(geometry, np.empty(0))
    network = Problem(campaign, design, with_held, 3.0).network()
    return adjust(network, network.start(design), design)


def known(datum: tuple[str, ...] = ("J1", "J2", "J3")) -> ArmUncertainty:
    adjustment = adjusted(datum)
    inverse = adjustment.split.inverse
    return arm_uncertainty(adjustment, inverse @ inverse.T)


def uncertain(geometry, parameters, covariance) -> ArmUncertainty:
    """An arm that nobody adjusted."""

    def columns(angles_rad):
        derivatives = probe_derivatives(geometry, angles_rad)
        n, values = len(angles_rad), ArmValues(geometry, np.empty(0))
        nothing = np.zeros(n, dtype=np.int64)
        poses = Poses(nothing, np.zeros(n), nothing, nothing, angles_rad)
        moves = parameters.columns(values, derivatives, poses)
        return moves, derivatives.centres_mm

    return ArmUncertainty(geometry, columns, covariance)


@pytest.fixture(scope="module")
def readings() -> np.ndarray:
    return adjusted(("J1", "J2", "J3")).network.campaign.poses.angles_rad


@pytest.mark.parametrize("turn_rad", [0.3, 1.0, 2.5])
def test_chord_of_a_clock_hand_grows_with_the_hand(turn_rad: float) -> None:
    # Chord 2 r sin(a/2): its derivative by r is 2 sin(a/2).
    geometry = one_joint(400.0)
    parameters = arm_parameters(geometry, ("J1",))
    along = next(
        name
        for name, row in zip(
            ("J1.link.v", "J1.link.w"), parameters.basis(geometry)[0], strict=True
        )
        if abs(row[0]) > 0.9
    )
    free = np.array([name == along for name in parameters.names])
    arm = uncertain(geometry, parameters.with_free(free), np.array([[0.01**2]]))
    deviations_mm = distance_deviations_mm(
        arm, np.zeros((1, 1)), np.array([[turn_rad]])
    )
    assert deviations_mm[0] == pytest.approx(
        0.01 * 2.0 * np.sin(turn_rad / 2.0), rel=1e-12
    )


def test_a_distance_of_a_pose_to_itself_has_no_direction_and_no_deviation() -> None:
    same = np.full((1, 7), 0.4)
    assert distance_deviations_mm(known(), same, same)[0] == 0.0


def test_deviations_do_not_depend_on_the_datum(readings: np.ndarray) -> None:
    first, second = known(), known(("J5", "J6"))
    first_names, second_names = (
        adjusted(datum).network.parameters.free_names
        for datum in (("J1", "J2", "J3"), ("J5", "J6"))
    )
    assert first_names != second_names
    pairs = readings[:80], readings[80:160]
    np.testing.assert_allclose(
        distance_deviations_mm(first, *pairs),
        distance_deviations_mm(second, *pairs),
        rtol=1e-4,  # both are linearised at their own, nearly equal arm
    )
    maps = [uncertainty_map(arm, readings).deviations_mm for arm in (first, second)]
    np.testing.assert_array_equal(*(np.isnan(values) for values in maps))
    np.testing.assert_allclose(*maps, rtol=1e-3)


def test_deviations_are_those_of_arms_drawn_at_random(readings: np.ndarray) -> None:
    arm, n_arms = known(), 2000
    parameters = adjusted(("J1", "J2", "J3")).network.parameters
    pairs = readings[:30], readings[90:120]
    rng = np.random.default_rng(5)
    root = np.linalg.cholesky(arm.covariance)
    values = ArmValues(arm.geometry, np.empty(0))
    drawn_mm = np.empty((n_arms, 30))
    for number in range(n_arms):
        step = root @ rng.normal(size=len(root))
        drawn = parameters.moved(values, step).geometry
        ends_mm = [probe_centre(drawn, angles_rad) for angles_rad in pairs]
        drawn_mm[number] = np.linalg.norm(ends_mm[0] - ends_mm[1], axis=1)
    # A standard deviation of n draws has the relative deviation 1 / sqrt(2 n).
    np.testing.assert_allclose(
        drawn_mm.std(axis=0, ddof=1),
        distance_deviations_mm(arm, *pairs),
        rtol=4.5 / np.sqrt(2.0 * n_arms),
    )


def test_postures_reach_their_places_within_the_travelled_ranges(
    readings: np.ndarray,
) -> None:
    arm = known()
    cloud = sample_postures(arm.geometry, readings)
    places_mm = probe_centre(arm.geometry, readings[::3])
    near = nearest_samples(cloud, places_mm)
    for rank in (0, 4):
        angles_rad, good = postures_reaching(cloud, places_mm, near[:, rank])
        assert np.mean(good) > 0.9
        away_mm = probe_centre(arm.geometry, angles_rad) - places_mm
        assert np.all(np.linalg.norm(away_mm[good], axis=1) < 0.5)
        assert np.all(angles_rad >= readings.min(axis=0) - 0.021)
        assert np.all(angles_rad <= readings.max(axis=0) + 0.021)
    away_mm = np.array([[5000.0, 0.0, 0.0]])
    _, good = postures_reaching(cloud, away_mm, nearest_samples(cloud, away_mm)[:, 0])
    assert not good[0]


def test_the_map_is_in_the_size_of_single_pairs_and_knows_its_worst_place(
    readings: np.ndarray,
) -> None:
    arm = known()
    uncertainty = uncertainty_map(arm, readings)
    assert uncertainty.length_mm == 500.0
    some = distance_deviations_mm(arm, readings[:100], readings[100:200])
    for name, figures in uncertainty.summary().items():
        assert figures.median_mm <= figures.quantile_95_mm <= figures.largest_mm
        assert 0.2 * np.median(some) < figures.median_mm < 5.0 * np.median(some), name
    assert set(uncertainty.summary()) == {
        "radial",
        "tangential",
        "axial",
        "from reference",
    }


def test_a_small_arm_gets_shorter_distances() -> None:
    geometry = TRUE.geometry()
    small = Geometry(
        geometry.origin_mm,
        geometry.axes,
        0.2 * geometry.links_mm,
        geometry.zeros_rad,
        geometry.probe_vector_mm,
        geometry.probe_direction,
    )
    parameters = arm_parameters(small, [f"J{k + 1}" for k in range(7)])
    parameters = with_datum(parameters, small)
    arm = uncertain(small, parameters, np.eye(parameters.n_free) * 1e-6)
    ranges_rad = np.stack([small.zeros_rad - 2.0, small.zeros_rad + 2.0])
    assert uncertainty_map(arm, ranges_rad).length_mm == 100.0


def test_an_arm_that_hardly_moved_has_an_empty_map() -> None:
    arm = known()
    still_rad = np.stack([arm.geometry.zeros_rad, arm.geometry.zeros_rad + 1e-6])
    uncertainty = uncertainty_map(arm, still_rad, 500.0)
    assert not np.any(np.isfinite(uncertainty.deviations_mm[:3]))


def placed_elsewhere(arm: TrueArm) -> TrueArm:
    """The same arm, turned and shifted as a whole."""
    turn = rotations(np.array([2.0, -1.0, 2.0]) / 3.0, np.array([0.7]))[0]
    return replace(
        arm,
        axes=arm.axes @ turn.T,
        links_mm=arm.links_mm @ turn.T,
        origin_mm=arm.origin_mm + np.array([400.0, -30.0, 20.0]),
    )


def test_an_arm_is_like_itself() -> None:
    comparison = compare_arms(arm_value(TRUE), arm_value(TRUE))
    assert comparison.rms_mm == pytest.approx(0.0, abs=1e-9)
    assert comparison.turn_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("at", ["elsewhere", "in another posture"])
def test_placing_and_posture_do_not_count(at: str) -> None:
    turns_rad = np.linspace(-0.9, 1.1, 7)
    other = (
        placed_elsewhere(TRUE)
        if at == "elsewhere"
        else in_another_posture(TRUE, turns_rad)
    )
    comparison = compare_arms(arm_value(TRUE), arm_value(other))
    assert comparison.largest_mm == pytest.approx(0.0, abs=1e-8)
    if at == "elsewhere":
        assert comparison.turn_rad == pytest.approx(0.7, abs=1e-9)
        assert comparison.shift_rms_mm > 100.0


def test_differences_are_those_of_an_independent_fit() -> None:
    first, second = disturbed(TRUE, 1), placed_elsewhere(disturbed(TRUE, 2))
    least, most = TRUE.zeros_rad - 1.0, TRUE.zeros_rad + 1.5
    comparison = compare_arms(arm_value(first), arm_value(second), (least, most), 500)
    assert np.all(
        (comparison.largest_at_rad >= least) & (comparison.largest_at_rad <= most)
    )
    # The same postures drawn again, to fit them with an independent function.
    rng = np.random.default_rng(20_171_101)
    angles_rad = rng.uniform(least, most, (500, 7))
    first_mm, second_mm = first.centres(angles_rad), second.centres(angles_rad)
    onto_mm = first_mm - first_mm.mean(axis=0)
    local_mm = second_mm - second_mm.mean(axis=0)
    turn, _ = Rotation.align_vectors(onto_mm, local_mm)
    apart_mm = np.linalg.norm(turn.apply(local_mm) - onto_mm, axis=1)
    assert comparison.rms_mm == pytest.approx(np.sqrt(np.mean(apart_mm**2)), rel=1e-9)
    assert comparison.median_mm == pytest.approx(np.median(apart_mm), rel=1e-9)
    assert comparison.largest_mm == pytest.approx(apart_mm.max(), rel=1e-9)
    worst = int(np.argmax(apart_mm))
    np.testing.assert_allclose(comparison.largest_at_mm, first_mm[worst], atol=1e-9)
    np.testing.assert_array_equal(comparison.largest_at_rad, angles_rad[worst])


def test_zones_share_out_all_postures() -> None:
    comparison = compare_arms(arm_value(TRUE), arm_value(disturbed(TRUE, 1)))
    assert [zone.name for zone in comparison.zones] == ["near", "middle", "far"]
    assert sum(zone.n_postures for zone in comparison.zones) == comparison.n_postures
    filled = [zone for zone in comparison.zones if zone.n_postures]
    squares = sum(zone.n_postures * zone.rms_mm**2 for zone in filled)
    assert squares == pytest.approx(
        comparison.n_postures * comparison.rms_mm**2, rel=1e-9
    )
    assert max(zone.largest_mm for zone in filled) == comparison.largest_mm


def test_arms_of_other_joints_are_refused_by_name() -> None:
    arm = arm_value(TRUE)
    fewer: Arm = arm.model_copy(update={"joints": arm.joints[:-1], "name": "short"})
    with pytest.raises(ComparisonError, match=r"'short' J1, J2, J3, J4, J5, J6;"):
        compare_arms(arm, fewer)

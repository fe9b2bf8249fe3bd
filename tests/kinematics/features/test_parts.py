import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.kinematics.features.parts import (
    TIP_MM,
    TIP_STD_MM,
    drawn_part,
    reaching,
    touched,
)
from tests.kinematics.uncertainty.test_joint_covariance import bench
from tests.kinematics.uncertainty.test_point_covariance import (
    arm,
    effects,
    geometry,
    postures,
)
from traverse.kinematics.features.figures import angle, distance, figures_of
from traverse.kinematics.features.measured import Features, Touches, measured_features
from traverse.kinematics.features.relations import related
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance

__all__ = ["arm", "bench", "effects", "geometry"]  # fixtures

PARTS = 40


def figures(features: Features):
    elements, errors = features.elements, features.errors
    named = {
        f"{name} {figure.name}": figure
        for name, element in elements.items()
        for figure in figures_of(element, errors)
    }
    plate, edge, shaft = elements["plate"], elements["edge"], elements["shaft"]
    hole = elements["hole a"]
    apex = related("apex", elements["cone"])
    foot = related("intersection", shaft, plate)
    return named | {
        "hole a to hole b": distance(hole, elements["hole b"], errors),
        "hole a to edge": distance(hole, edge, errors),
        "shaft to edge": distance(foot, edge, errors),
        "apex to plate": distance(apex, plate, errors),
        "shaft to plate angle": angle(shaft, plate, errors),
        "edge to plate angle": angle(edge, plate, errors),
        "shaft to cone": distance(shaft, elements["cone"], errors),
    }


@pytest.fixture(scope="module")
def measured(bench):
    """Errors over standard uncertainties of 40 parts, by figure, and the last part."""
    rng = np.random.default_rng(43)
    start_rad = postures(bench.geometry, 1, 5)
    at_mm = bench.measured(start_rad, None)[0]
    turn = Rotation.random(random_state=4).as_matrix()
    ratios: dict[str, list[float]] = {}
    nominal_rad = None
    for _ in range(PARTS):
        part = drawn_part(rng, at_mm, turn)
        if nominal_rad is None:
            nominal_rad = np.tile(start_rad, (len(part.centres_mm), 1))
            nominal_rad = reaching(
                lambda angles_rad: bench.measured(angles_rad, None),
                nominal_rad,
                part.centres_mm,
            )
        features = measured_features(
            part.definitions, touched(bench, part, nominal_rad, rng)
        )
        assert features.problems == {}
        named = figures(features)
        assert named.keys() >= part.truth.keys()
        for name, truth in part.truth.items():
            ratio = (named[name].value - truth) / named[name].std
            ratios.setdefault(name, []).append(ratio)
    return {name: np.array(each) for name, each in ratios.items()}, features


@pytest.mark.slow
def test_figures_of_40_parts_lie_within_their_uncertainty(measured):
    """Strategy: k = 2 holds 95.45 %. Figures of a part hang together by its arm, so
    the bounds are wide; what errs on purpose (forms and lengths of zero) holds more.
    """
    ratios, _ = measured
    inside = {name: float(np.mean(np.abs(r) <= 2.0)) for name, r in ratios.items()}
    assert min(inside.values()) >= 0.85, inside
    assert np.mean(list(inside.values())) >= 0.94


@pytest.mark.slow
def test_uncertainties_are_not_larger_than_the_errors_need(measured):
    """The root mean square of 40 scatters by a ninth: within three of that."""
    ratios, _ = measured
    for name in ("hole a diameter", "shaft diameter", "cone angle", "hole a to hole b"):
        assert 0.65 < float(np.sqrt(np.mean(ratios[name] ** 2))) < 1.35, name


def test_the_ball_moves_figures_as_its_stated_radius_does():
    """Against differences of figures with balls of two radii, without other errors."""
    part = drawn_part(np.random.default_rng(5), np.array([300.0, 50, 90]), np.eye(3))
    n = len(part.centres_mm)
    exact = JointCovariance(part.centres_mm, np.zeros((n, 3, 3)), np.zeros((n, 3, 0)))
    is_measured = np.ones(n, dtype=bool)

    def with_ball(radius_mm):
        touches = Touches(exact, radius_mm, TIP_STD_MM, part.towards, is_measured)
        return figures(measured_features(part.definitions, touches))

    smaller, larger = with_ball(TIP_MM - 0.01), with_ball(TIP_MM + 0.01)
    moved = {}
    for name, stated in with_ball(TIP_MM).items():
        if name not in ("shaft to cone", "edge to plate angle"):  # lengths of zero
            moved[name] = (larger[name].value - smaller[name].value) / 0.02
            expected = abs(moved[name]) * TIP_STD_MM
            assert stated.std == pytest.approx(expected, abs=1e-7), name
    assert moved["hole a diameter"] == pytest.approx(2.0)
    assert moved["shaft diameter"] == pytest.approx(-2.0)
    assert moved["hole a to edge"] == pytest.approx(-1.0)
    assert moved["hole a to hole b"] == pytest.approx(0.0, abs=1e-9)
    assert moved["apex to plate"] == pytest.approx(1.0 - 1.0 / np.sin(half_angle(part)))


def half_angle(part):
    return part.truth["cone angle"] / 2.0


@pytest.mark.slow
def test_what_the_holes_share_of_the_arm_does_not_widen_their_distance(measured):
    _, features = measured
    named = figures(features)
    places = [named[f"hole {k} {axis}"].std for k in "ab" for axis in "xyz"]
    apart = float(np.sqrt(np.sum(np.square(places)) / 3.0))
    assert named["hole a to hole b"].std < 0.7 * apart

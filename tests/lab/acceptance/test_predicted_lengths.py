"""What the arm's files predict of errors of length, against differences and chance."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.acceptance.test_lengths import SQUARE, seats
from tests.lab.measurements import (
    OCTAHEDRON,
    TIP_MM,
    artefact,
    limits,
    measured,
    on_a_ball,
    touches,
)
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.lab.acceptance.procedures.lengths import errors_of
from traverse.lab.acceptance.procedures.predicted_lengths import predicted_lengths

N_ARMS = 400


def bar():
    ends = [on_a_ball(c, 10.0, OCTAHEDRON) for c in ([0.0, 0, 0], [200.0, 220.0, -9.0])]
    keys = {"radius_mm": (10.0, 10.0), "distance_std_mm": 0.002}
    length_mm = float(np.linalg.norm([200.0, 220.0, -9.0]))
    standard = artefact("L", "ball_bar", distance_mm=length_mm, **keys)
    return standard, touches(np.concatenate(ends), ["1"] * 6 + ["2"] * 6)


def planes(*, swapped=False):
    top = SQUARE + np.array([3.0, 1.0, 100.0 + 2 * TIP_MM])
    standard = artefact("L", "parallel_planes", distance_mm=100.0)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    places = np.concatenate([SQUARE, top]) @ turn.T
    features = ["2"] * 4 + ["1"] * 4 if swapped else ["1"] * 4 + ["2"] * 4
    return standard, touches(places, features)


ENTRIES = {
    "bar": bar,
    "planes": planes,
    "planes, second face first": lambda: planes(swapped=True),
    "seats": lambda: seats("L", 500.0, [0.01, -0.02]),
}


def with_errors(entry, own_mm2, shared_mm):
    standard, touched = entry
    n = len(touched)
    total = own_mm2 * np.tile(np.eye(3), (n, 1, 1))
    total = total + shared_mm @ shared_mm.transpose(0, 2, 1)
    errors = JointCovariance(touched.places_mm, total, shared_mm)
    data = measured((standard, replace(touched, errors=errors)))
    return replace(data, errors_unknown=None)


def errors_mm(entry, places_mm):
    standard, touched = entry
    data = measured((standard, replace(touched, places_mm=places_mm)))
    return np.array([e.error_mm for e in errors_of(data, "L", "e_uni", limits())])


@pytest.mark.parametrize("kind", ENTRIES)
def test_what_all_touches_share_moves_a_length_as_differences_say(kind):
    entry, rng = ENTRIES[kind](), np.random.default_rng(2)
    for _ in range(5):
        way = rng.normal(size=(len(entry[1]), 3, 1))
        data = with_errors(entry, 0.0, 1e-3 * way)
        lengths = predicted_lengths(data, errors_of(data, "L", "e_uni", limits())[:1])
        places_mm, step = entry[1].places_mm, 1e-5 * way[..., 0]
        ends = [errors_mm(entry, places_mm + s * step)[0] for s in (1.0, -1.0)]
        assert lengths.stds_mm[0] == pytest.approx(
            1e-3 * abs(ends[0] - ends[1]) / 2e-5, rel=1e-5
        )


def test_touches_alone_by_hand():
    data = with_errors(ENTRIES["seats"](), 1e-4, np.zeros((4, 3, 0)))
    lengths = predicted_lengths(data, errors_of(data, "L", "e_uni", limits()))
    assert lengths.stds_mm == pytest.approx([np.sqrt(2e-4)] * 2)
    # Errors 0.01 and -0.02 of standard uncertainty 0.01414, and a standard of almost 0.
    assert lengths.sigma0 == pytest.approx(np.sqrt((0.5 + 2.0) / 2.0), rel=1e-3)
    assert lengths.n_inside == 2


@pytest.mark.parametrize("kind", ["bar", "planes"])
def test_errors_of_drawn_arms_are_as_predicted_and_larger_ones_are_found(kind):
    entry, rng = ENTRIES[kind](), np.random.default_rng(3)
    standard, touched = entry
    shared = rng.normal(0.0, 0.01, (len(touched), 3, 4))
    std_mm = getattr(standard, "distance_std_mm", None) or 0.0
    data = with_errors(entry, 1e-4, shared)
    p_values, inside = [], 0
    for _ in range(N_ARMS):
        places_mm = touched.places_mm + rng.normal(0.0, 0.01, touched.places_mm.shape)
        places_mm = places_mm + shared @ rng.normal(size=4)
        moved = replace(data.touched["L"], places_mm=places_mm)
        found_data = replace(data, touched={"L": moved})
        errors = errors_of(found_data, "L", "e_uni", limits())
        # The certificate is wrong by its own uncertainty.
        wrong_mm = std_mm * rng.normal()
        errors = [replace(e, error_mm=e.error_mm + wrong_mm) for e in errors]
        predicted = predicted_lengths(found_data, errors)
        p_values.append(predicted.p_value)
        inside += predicted.n_inside
    assert 0.92 < inside / N_ARMS < 0.98
    assert 0.44 < np.mean(p_values) < 0.56
    too_small = [replace(e, error_mm=5.0 * e.error_mm + 0.1) for e in errors]
    assert not predicted_lengths(found_data, too_small).explains


def test_nothing_is_predicted_of_points_without_angles():
    data = measured(ENTRIES["seats"]())
    assert data.errors_unknown == "the points have no angles"
    errors = errors_of(data, "L", "e_uni", limits())
    assert predicted_lengths(data, errors) is None

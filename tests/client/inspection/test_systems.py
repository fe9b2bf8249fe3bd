"""Leapfrog: what two stations share, drawn arms, and what is refused on the way."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.client.display.values import point
from traverse.client.inspection.plan import FeatureEntry, Plan, RelationEntry
from traverse.client.inspection.results import inspected
from traverse.client.inspection.systems import (
    in_first_system,
    station_of_fit,
    system_by_leapfrog,
)

COMMON_MM = np.array(
    [[0.0, 0, 0], [600, 0, 50], [600, 400, 0], [0, 400, 150], [300, 200, 300]]
)
FIRST_MM, LAST_MM = np.array([-200.0, 50, 20]), np.array([900.0, 300, 100])
OWN_MM = 0.01
NAMES = [f"c{row}" for row in range(len(COMMON_MM))]
AGAIN = {f"{name} again": name for name in NAMES}
PLAN = Plan(
    schema="traverse/features/1",
    ball_radius_std_mm=0.0,
    features=tuple(
        FeatureEntry(name=name, kind="point", side="centre")
        for name in (*NAMES, *AGAIN, "first", "last")
    ),
    relations=(RelationEntry(name="length", kind="distance", of=("first", "last")),),
)
UPPER = np.triu_indices(3)


def factors_mm(places_mm):
    """Return what two parameters of an arm do: its scale, and a twist with height."""
    x, y, z = places_mm.T
    scale = 6e-5 * places_mm
    twist = 1e-7 * np.column_stack([-y * z, x * z, np.zeros(len(z))])
    return np.stack([scale, twist], axis=2)


def touched(rng, parameters, names, true_mm, number):
    shared_mm = factors_mm(true_mm)
    read_mm = true_mm + shared_mm @ parameters + OWN_MM * rng.normal(size=true_mm.shape)
    covariances = OWN_MM**2 * np.eye(3) + shared_mm @ shared_mm.transpose(0, 2, 1)
    points = [
        point(
            number + row,
            xyz_mm=read_mm[row].tolist(),
            covariance_mm2=covariances[row][UPPER].tolist(),
            part_xyz_mm=None,
            compensation="none",
            surface_mm=None,
            label={"artefact": "part", "feature": name},
            quality={"ok": True, "flags": []},
        )
        for row, name in enumerate(names)
    ]
    ids = [each.id for each in points]
    return points, dict(zip(ids, shared_mm, strict=True))


def two_stations(rng):
    """Draw an arm, and touch from two stations; return touches and the true move."""
    turn = Rotation.random(random_state=rng)
    shift_mm = rng.uniform(-800, 800, 3)
    parameters = rng.normal(size=2)
    first_mm = np.vstack([COMMON_MM, FIRST_MM])
    first, shared = touched(rng, parameters, [*NAMES, "first"], first_mm, 0)
    again_mm = turn.inv().apply(np.vstack([COMMON_MM, LAST_MM]) - shift_mm)
    again, more = touched(rng, parameters, [*AGAIN, "last"], again_mm, 100)
    return first, again, shared | more


def measured(first, again, shared):
    points = [*first, *again]
    fit = system_by_leapfrog(PLAN, points, shared, AGAIN)
    of_station = dict.fromkeys((each.id for each in again), 0)
    placed, widened = in_first_system(points, shared, [station_of_fit(fit)], of_station)
    results = inspected(PLAN, placed, widened)
    return fit, {feature.name: feature for feature in results.features}


def test_a_length_between_two_stations_is_within_its_uncertainty():
    rng = np.random.default_rng(11)
    true_mm = np.linalg.norm(LAST_MM - FIRST_MM)
    ratios, squares = [], []
    for _ in range(80):
        fit, results = measured(*two_stations(rng))
        (length,) = results["length"].figures
        ratios.append((length.value - true_mm) / (0.5 * length.expanded))
        squares.append(fit.sigma0**2 * fit.redundancy)
    assert fit.redundancy == 9
    assert np.mean(squares) == pytest.approx(9.0, abs=1.2)
    assert np.std(ratios) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(ratios)) < 0.3


def test_a_feature_touched_again_lies_where_it_was():
    fit, results = measured(*two_stations(np.random.default_rng(3)))
    for again, before in AGAIN.items():
        off_mm = np.subtract(results[before].place_mm, results[again].place_mm)
        np.testing.assert_allclose(off_mm, fit.residuals_mm[again], atol=1e-9)


def test_without_uncertainty_places_come_and_none_is_stated():
    first, again, _ = two_stations(np.random.default_rng(4))
    fit, results = measured(first, again, "no arm file")
    assert fit.error is None
    (length,) = results["length"].figures
    assert length.expanded is None
    assert length.value == pytest.approx(np.linalg.norm(LAST_MM - FIRST_MM), abs=0.5)

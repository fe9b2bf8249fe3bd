"""Minimal detectable sizes: power by simulation, undetectable effects, and plans."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from tests.lab.diagnosis.fitted_rows import arm_with_masses, measured, measured_rows
from tests.lab.simulated import TrueArm, cones, seven_joints, simulate
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.model.forward import probe_centre
from traverse.lab.diagnosis.advice.minimal_detectable import (
    detectable,
    left_at_probe_mm,
    planned,
    planned_equations,
)
from traverse.lab.diagnosis.candidates.library import absent_candidates, library_bank
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.fit import fitted
from traverse.lab.diagnosis.model.observation_equations import equations_of


@cache
def bank() -> Bank:
    return library_bank(measured_rows(), measured().arm)


@cache
def all_found():
    return detectable(measured_rows(), bank())


def found_of(kind, joint=None, order=None, component=None):
    identity = (kind, joint, order, component, None)
    places = [c.identity for c in bank().candidates]
    at = places.index(identity)
    return all_found()[at], bank().columns[:, bank().slices[at]]


def projected(columns):
    unknowns = measured_rows().columns
    left, values, _ = np.linalg.svd(unknowns, full_matrices=False)
    basis = left[:, values > 0.02]
    return columns - basis @ (basis.T @ columns)


def test_a_single_column_by_the_formula():
    rows = measured_rows()
    size, column = found_of("encoder_scale", "J3")
    length = float(np.linalg.norm(projected(column)))
    level = 0.005 / len(bank().candidates)
    spare = rows.redundancy - 1
    critical = stats.f.isf(level, 1, spare)
    sigma = np.sqrt(rows.sum_of_squares / rows.redundancy)
    root = size.minimum.value / size.candidate.scales[0] * length / sigma
    assert stats.ncf.sf(critical, 1, spare, root**2) == pytest.approx(0.95, abs=1e-4)
    assert size.minimum == size.best
    assert (size.key, size.minimum.unit, size.why) == ("scale_ppm", "ppm", None)


@pytest.mark.parametrize(
    "which",
    [
        ("encoder_eccentricity", "J2"),
        ("axis_wobble", "J4", 2),
        ("base_drift",),
    ],
)
def test_what_is_just_detectable_is_found_in_95_of_100(which):
    rows = measured_rows()
    size, columns = found_of(*which)
    clean = projected(columns)
    directions, values, turned = np.linalg.svd(clean, full_matrices=False)
    n_draws, q = 1500, columns.shape[1]
    sigma = np.sqrt(rows.sum_of_squares / rows.redundancy)
    # In the weakest direction, an amplitude of the stated size.
    amplitude = size.minimum.value / size.candidate.scales[0]
    signal = clean @ (turned[-1] * amplitude)
    rng = np.random.default_rng(8)
    noise = rng.standard_normal((len(rows.values), n_draws))
    residuals = signal[:, np.newaxis] + sigma * projected(noise)
    explained = np.sum((directions.T @ residuals) ** 2, axis=0)
    left = np.sum(residuals**2, axis=0) - explained
    spare = rows.redundancy - q
    tests = explained / q / (left / spare)
    level = 0.005 / len(bank().candidates)
    seen = np.mean(tests > stats.f.isf(level, q, spare))
    assert seen == pytest.approx(0.95, abs=3.5 * np.sqrt(0.05 * 0.95 / n_draws))
    assert size.best.value <= size.minimum.value
    assert size.best.value / size.minimum.value == pytest.approx(values[-1] / values[0])


def test_a_stricter_threshold_needs_a_larger_effect():
    strict = detectable(measured_rows(), bank(), log_p=-40.0)
    for loose, size in zip(all_found(), strict, strict=True):
        if loose.minimum is not None:
            assert size.minimum.value > 1.3 * loose.minimum.value


def test_a_vertical_first_joint_is_not_twisted_by_gravity():
    truth = seven_joints()
    campaign = simulate(truth, cones(3), 30, 4)
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    arm = arm_with_masses(truth)
    rows = equations_of(fitted(campaign, arm, everyone).adjustment)
    names = library_bank(rows, arm)
    by_name = {size.candidate.name: size for size in detectable(rows, names)}
    compliance = by_name["joint_compliance J1"]
    assert compliance.minimum is None
    assert compliance.why == "J1 is vertical: gravity does not twist it"
    assert by_name["joint_compliance J2"].minimum is not None


def test_a_probe_on_the_last_axis_hides_that_joints_encoder():
    truth = seven_joints()
    links_mm = truth.links_mm.copy()
    links_mm[-1] = [145.0, 0.0, 0.0]
    truth = TrueArm(truth.axes, links_mm, truth.zeros_rad, truth.origin_mm)
    campaign = simulate(truth, cones(3), 30, 4)
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    arm = arm_with_masses(truth)
    adjustment = fitted(campaign, arm, everyone).adjustment
    state = replace(adjustment.state.arm, geometry=truth.geometry())
    state = replace(adjustment.state, arm=state)
    rows = equations_of(replace(adjustment, state=state))
    names = library_bank(rows, arm)
    by_name = {size.candidate.name: size for size in detectable(rows, names)}
    eccentricity = by_name["encoder_eccentricity J7"]
    assert eccentricity.minimum is None
    assert "the probe lies on the axis of J7" in eccentricity.why


def test_a_screw_motion_of_the_last_joint_equals_a_change_of_the_geometry():
    size, columns = found_of("axis_runout", "J7", 1, "axial")
    assert np.linalg.norm(columns) > 1.0
    assert size.minimum is None
    assert "equals a change of the geometry" in size.why


def test_what_the_campaign_lacks_is_reported():
    campaign = measured().campaign.with_poses(
        temperature_c=None, joint_temperatures_c=None
    )
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    arm = measured().arm
    rows = equations_of(fitted(campaign, arm, everyone).adjustment)
    absent = absent_candidates(rows, arm)
    sizes = detectable(rows, library_bank(rows, arm), absent)
    of_links = [size for size in sizes if size.candidate.name == "thermal_expansion"]
    assert of_links[0].minimum is None
    assert "temperature" in of_links[0].why
    assert "block" not in of_links[0].why


def test_nothing_is_left_of_what_the_arm_absorbs():
    rows = measured_rows()
    n_free = rows.adjustment.network.parameters.n_free
    left_mm = left_at_probe_mm(rows, rows.columns[:, :n_free])
    assert np.all(left_mm < 1e-5)


def test_a_motion_of_everything_together_is_no_error_of_the_arm():
    rows = measured_rows()
    moves = np.broadcast_to([0.3, -0.2, 0.1], (len(rows.block), 3))[:, :, np.newaxis]
    places_mm = probe_centre(rows.adjustment.state.arm.geometry, rows.block.angles_rad)
    turned = np.cross([1e-4, 2e-4, -1e-4], places_mm)[:, :, np.newaxis]
    left_mm = left_at_probe_mm(rows, rows.moved(np.concatenate([moves, turned], 2)))
    assert np.all(left_mm < 1e-5)


def test_what_is_left_of_an_undetected_effect_is_of_the_size_of_the_noise():
    # 5 urad at 0.7 m and 5 um: some 7 um a pose, 240 poses.
    for size in all_found():
        if size.minimum is not None and size.candidate.artefact is None:
            assert 1e-4 < size.probe_mm < 0.02


SLIPPING = {
    "kind": "encoder_eccentricity",
    "joint": "J3",
    "cos_rad": 8e-5,
    "sin_rad": -8e-5,
}


def minima(sizes):
    return {
        size.candidate.name: size.minimum.value
        for size in sizes
        if size.minimum is not None
    }


def test_the_plan_says_what_the_measured_campaign_says():
    before = minima(planned(measured().campaign, measured().arm))
    rows = measured_rows()
    after = minima(all_found())
    sigma = np.sqrt(rows.sum_of_squares / rows.redundancy)
    # The axis of J1 was estimated a little tilted: a trace of gravity about it.
    assert after.keys() - before.keys() <= {"joint_compliance J1"}
    ratios = np.array([sigma * before[name] / after[name] for name in before])
    assert np.quantile(ratios, [0.05, 0.95]) == pytest.approx(1.0, abs=0.05)


def test_misclosures_are_not_looked_at():
    rows = planned_equations(measured().campaign, measured().arm)
    assert not np.any(rows.values)
    wrong = measured().with_effect(effect_from_table(SLIPPING))
    before = minima(planned(measured().campaign, measured().arm))
    after = minima(planned(wrong.campaign, wrong.arm))
    for name, minimum in before.items():
        assert after[name] == pytest.approx(minimum, rel=0.03)


def test_twice_the_noise_needs_twice_the_size():
    campaign = measured().campaign
    noisy = replace(
        campaign,
        encoder_rad=2.0 * campaign.encoder_rad,
        contact_mm=2.0 * campaign.contact_mm,
    )
    before = minima(planned(campaign, measured().arm))
    after = minima(planned(noisy, measured().arm))
    for joint in ("J1", "J3", "J5"):
        name = f"encoder_eccentricity {joint}"
        assert after[name] == pytest.approx(2.0 * before[name], rel=0.02)


def test_an_effect_of_the_arm_is_estimated_too():
    arm = measured().arm.model_copy(update={"effects": (effect_from_table(SLIPPING),)})
    by_name = {size.candidate.name: size for size in planned(measured().campaign, arm)}
    assert by_name["encoder_eccentricity J3"].minimum is None
    assert by_name["encoder_eccentricity J1"].minimum is not None

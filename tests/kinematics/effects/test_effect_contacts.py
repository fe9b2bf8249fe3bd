import numpy as np
import pytest

from tests.kinematics.effects.reference import (
    Rigid,
    effect,
    random_arm,
    random_readings,
)
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import contact_shifts, corrected_pose
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm

ARM = random_arm(21)
GEOMETRY = geometry_from_arm(ARM)
READINGS = random_readings(22, n_samples=6)
DIRECTIONS = np.random.default_rng(23).normal(size=(6, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def shifts(correction, **covariates):
    block = Block(READINGS, **{"directions": DIRECTIONS, **covariates})
    effects = effects_of(ARM, (correction,))
    centres, shanks, flags = corrected_pose(GEOMETRY, effects, block)
    nominal, nominal_shanks = probe_pose(GEOMETRY, READINGS)
    np.testing.assert_allclose(shanks, nominal_shanks, rtol=0, atol=1e-14)
    shift_mm = contact_shifts(GEOMETRY, effects, block)
    np.testing.assert_allclose(centres - nominal, shift_mm, atol=1e-11)
    return shift_mm, flags


def test_larger_ball_brings_the_material_further():
    shift_mm, _ = shifts(effect("probe_radius", radius_error_mm=0.004))
    np.testing.assert_allclose(shift_mm, 0.004 * DIRECTIONS, rtol=1e-14)
    # The material is where the larger ball ends: radius_mm + radius_error_mm away.
    nominal, _ = probe_pose(GEOMETRY, READINGS)
    surface = nominal + shift_mm + 3.0 * DIRECTIONS
    np.testing.assert_allclose(
        np.linalg.norm(surface - nominal, axis=1), 3.004, rtol=1e-12
    )


def test_lobing_leaves_the_material_by_the_pretravel_of_the_azimuth():
    shift_mm, _ = shifts(effect("probe_lobing", amplitude_mm=0.002, phase_rad=0.4))
    shank = GEOMETRY.probe_direction
    smallest = np.eye(3)[np.argmin(np.abs(shank))]
    first = np.cross(np.cross(shank, smallest), shank)
    first /= np.linalg.norm(first)
    for n, sample in enumerate(READINGS):
        rigid = Rigid(GEOMETRY, sample - GEOMETRY.zeros_rad)
        local = rigid.carried[-1][:3, :3].T @ DIRECTIONS[n]
        flat = local - shank * (shank @ local)
        psi = np.arctan2(shank @ np.cross(first, flat), first @ flat)
        expected = -0.002 * np.cos(3 * psi - 0.4) * DIRECTIONS[n]
        np.testing.assert_allclose(shift_mm[n], expected, rtol=0, atol=1e-15)


def test_stylus_yields_across_the_shank_away_from_the_material():
    force_n = np.array([2.0, 0.5, np.nan, 1.0, 0.0, 3.0])
    shift_mm, _ = shifts(
        effect("stylus_bending", compliance_mm_n=0.01), force_n=force_n
    )
    shanks = probe_pose(GEOMETRY, READINGS)[1]
    across = np.cross(shanks, np.cross(DIRECTIONS, shanks))
    known = np.where(np.isnan(force_n), 1.0, force_n)
    np.testing.assert_allclose(shift_mm, -0.01 * known[:, None] * across, atol=1e-15)


def test_force_that_is_not_known_at_all_is_one_newton():
    correction = effect("stylus_bending", compliance_mm_n=0.01)
    np.testing.assert_array_equal(
        shifts(correction)[0], shifts(correction, force_n=np.ones(6))[0]
    )


KINDS = [
    effect("probe_radius", radius_error_mm=0.1),
    effect("probe_lobing", amplitude_mm=0.1, phase_rad=0.0),
    effect("stylus_bending", compliance_mm_n=0.1),
]


@pytest.mark.parametrize("correction", KINDS, ids=lambda correction: correction.kind)
def test_unknown_surface_is_flagged_and_nothing_corrected(correction):
    some = DIRECTIONS.copy()
    some[[1, 4]] = np.nan
    shift_mm, flags = shifts(correction, directions=some)
    np.testing.assert_array_equal(flags.surface_unknown, [0, 1, 0, 0, 1, 0])
    assert not shift_mm[[1, 4]].any()
    assert np.linalg.norm(shift_mm[[0, 2, 3, 5]], axis=1).min() > 1e-4
    shift_mm, flags = shifts(correction, directions=None)
    assert flags.surface_unknown.all()
    assert not shift_mm.any()


def test_direction_along_the_shank_has_a_finite_lobing():
    shanks = probe_pose(GEOMETRY, READINGS)[1]
    shift_mm, _ = shifts(
        effect("probe_lobing", amplitude_mm=0.002, phase_rad=0.4), directions=shanks
    )
    assert np.isfinite(shift_mm).all()
    assert np.abs(shift_mm).max() <= 0.002

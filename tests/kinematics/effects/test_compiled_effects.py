"""The kernel in C with effects: against NumPy, in every variant, and against itself."""

import os
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from tests.kinematics.arms import size_mm
from tests.kinematics.effects.reference import N_JOINTS
from tests.kinematics.effects.samples import (
    ARM,
    CAMPAIGN,
    EVERY_KIND,
    GEOMETRY,
    full_block,
)
from tests.running import run_program
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import (
    compiled_pose,
    corrected_pose,
    numpy_corrected_pose,
)
from traverse.kinematics.kernel.terms import Form, Quantity, Source, Term
from traverse.kinematics.model.geometry import Coupling

compiled = pytest.importorskip("traverse.kinematics.kernel.compiled")
VARIANTS = compiled.runnable_variants()
ROOT = Path(__file__).parents[3]
ALL = effects_of(ARM, EVERY_KIND, CAMPAIGN)
LEVERS_KG_M = 1e-3 * ALL.levers_kg_mm(GEOMETRY)
GRAVITY = ALL.gravity_m_s2.tolist()


def chain(variant, effects=ALL):
    terms = [t for c in (*effects.readings, *effects.mechanical) for t in c.terms]
    return compiled.DeflectedChain(GEOMETRY, variant, terms, LEVERS_KG_M)


def bits(*arrays):
    return tuple(np.where(np.isnan(a), np.nan, a).tobytes() for a in arrays)


@pytest.mark.parametrize("number", range(len(EVERY_KIND)))
def test_each_effect_is_what_numpy_makes_of_it(number):
    effects = effects_of(ARM, (EVERY_KIND[number],), CAMPAIGN)
    block = full_block(seed=number, n_samples=70)
    for part in (block, replace(block, directions=None, joint_temperatures_c=None)):
        agree(effects, part)


def test_all_effects_together_are_what_numpy_makes_of_them():
    agree(ALL, full_block(seed=40, n_samples=500))
    agree(ALL, replace(full_block(seed=41, n_samples=9), temperature_c=np.zeros(9)))
    tilted = np.array([1.0, 2.0, -9.0])
    agree(ALL, replace(full_block(seed=42, n_samples=9), gravity_m_s2=tilted))
    coupled = replace(GEOMETRY, couplings=(Coupling(2, 1, -1.0), Coupling(5, 2, 0.5)))
    agree(ALL, full_block(seed=46, n_samples=500), coupled)


def agree(effects, block, geometry=GEOMETRY):
    centres, shanks, _ = corrected_pose(geometry, effects, block)
    expected, expected_shanks = numpy_corrected_pose(geometry, effects, block)
    # NumPy rounds each turn, up to 7 rad, and the effect's part of it.
    lost = 14 * 2**-53 * N_JOINTS
    np.testing.assert_allclose(centres, expected, rtol=0, atol=lost * size_mm(GEOMETRY))
    np.testing.assert_allclose(shanks, expected_shanks, rtol=0, atol=lost)


@pytest.mark.parametrize(
    "kind", ["mount_compliance", "axis_wobble", "thermal_expansion"]
)
def test_effects_many_times_as_large_are_what_numpy_makes_of_them(kind):
    """Tilts of whole radians and elements twice as long: nothing is linearised."""
    ones = tuple(e for e in EVERY_KIND if e.kind == kind)
    effects = effects_of(ARM, ones)
    effects = effects.with_values(2e4 * effects.values)
    block = full_block(seed=43, n_samples=60)
    centres = corrected_pose(GEOMETRY, effects, block)[0]
    expected = numpy_corrected_pose(GEOMETRY, effects, block)[0]
    np.testing.assert_allclose(centres, expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("variant", VARIANTS)
def test_variants_and_blocks_leave_every_bit(variant):
    block = full_block(seed=44, n_samples=101)
    undivided = chain(variant).poses(block, GRAVITY)
    assert bits(*undivided) == bits(*chain(VARIANTS[0]).poses(block, GRAVITY))
    for first, n_samples in ((0, 1), (13, 2), (40, 8), (60, 33), (100, 1)):
        part = slice(first, first + n_samples)
        poses = chain(variant).poses(block.part(part), GRAVITY)
        assert bits(*poses) == bits(*(array[part] for array in undivided))


def test_what_is_no_number_spoils_its_sample_alone():
    block = full_block(seed=45, n_samples=50)
    clean = chain(VARIANTS[-1]).poses(block, GRAVITY)
    for name in ("angles_rad", "speeds_rad_s", "approaches"):
        spoilt = getattr(block, name).copy()
        spoilt[17, 1] = np.nan
        poses = chain(VARIANTS[-1]).poses(replace(block, **{name: spoilt}), GRAVITY)
        assert np.isnan(poses[0][17]).all()
        rest = np.delete(np.arange(50), 17)
        assert bits(*(a[rest] for a in poses)) == bits(*(a[rest] for a in clean))


def test_readings_of_many_turns_are_reduced_exactly():
    effects = effects_of(ARM, EVERY_KIND[9:12], CAMPAIGN)
    block = full_block(seed=46, n_samples=40)
    turned = replace(block, angles_rad=block.angles_rad + 40 * np.pi)
    near = corrected_pose(GEOMETRY, effects, block)[0]
    far = corrected_pose(GEOMETRY, effects, turned)[0]
    # 40 pi is rounded, and so is the sum: 2e-14 rad a joint.
    np.testing.assert_allclose(far, near, rtol=0, atol=2e-13 * size_mm(GEOMETRY))
    for far_rad in (1e5, np.inf):
        beyond = block.angles_rad.copy()
        beyond[3] += far_rad
        centres_mm = corrected_pose(
            GEOMETRY, effects, replace(block, angles_rad=beyond)
        )[0]
        assert np.isfinite(centres_mm[3]).all() == np.isfinite(far_rad)
        assert bits(centres_mm[4:]) == bits(near[4:])


def test_results_go_where_they_are_requested_and_columns_may_lie_anyhow():
    block = full_block(seed=47, n_samples=35)
    expected = chain(VARIANTS[-1]).poses(block, GRAVITY)
    into = np.zeros((35, 8))
    centres, directions = into[:, 1:4], into[:, 5:8]
    poses = chain(VARIANTS[-1]).poses(block, GRAVITY, centres, directions)
    assert poses[0] is centres
    assert poses[1] is directions
    assert bits(*poses) == bits(*expected)
    assert not into[:, [0, 4]].any()
    double = {
        f.name: np.repeat(getattr(block, f.name), 2, axis=0)[::2]
        for f in fields(block)
        if f.name != "gravity_m_s2"
    }
    strided = chain(VARIANTS[-1]).poses(replace(block, **double), GRAVITY)
    assert bits(*strided) == bits(*expected)
    swapped = replace(block, temperature_c=block.temperature_c.astype(">f8"))
    poses = compiled_pose(GEOMETRY, ALL, swapped)
    assert poses is None or bits(*poses) == bits(*expected)


@pytest.mark.parametrize(
    "term",
    [
        Term(form=Form.TURN_MOMENT, values=(1.0,), joint=N_JOINTS),
        Term(form=Form.TURN_MOMENT, values=(1.0,), joint=-1),
        Term(form=Form.BASE_RATE, values=(1.0,) * 7, of=Quantity(Source.STEP)),
        Term(form=Form.READING_RATE, values=(1.0,), of=Quantity(Source.SPEED)),
        Term(form=Form.READING_SPLINE, of=Quantity(Source.FORCE), spline=(1.0,) * 4),
        Term(form=Form.READING_SPLINE, of=Quantity(Source.FORCE), spline=(1.0,) * 9),
    ],
)
def test_terms_that_would_reach_beyond_the_arm_are_refused(term):
    with pytest.raises(ValueError, match="kernel: Term"):
        compiled.DeflectedChain(GEOMETRY, VARIANTS[0], [term], LEVERS_KG_M)


def test_columns_of_another_shape_or_type_are_refused():
    made = chain(VARIANTS[0])
    block = full_block(seed=49, n_samples=6)
    with pytest.raises(ValueError, match="utc_ns has dtype float64, expected aligned"):
        made.poses(replace(block, utc_ns=np.zeros(6)), GRAVITY)
    narrow = np.zeros((6, N_JOINTS - 1))
    with pytest.raises(ValueError, match="angles_rad has shape"):
        made.poses(Block(narrow), GRAVITY)
    with pytest.raises(ValueError, match="centres_mm has shape"):
        made.poses(block, GRAVITY, np.empty((5, 3)))


@pytest.mark.slow
def test_laws_of_the_effects_hold_without_the_kernel():
    files = ("blocks", "contacts", "mechanics", "readings")
    run_program(
        *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"),
        *(f"tests/kinematics/effects/test_effect_{name}.py" for name in files),
        cwd=ROOT,
        env={**os.environ, "TRAVERSE_KERNEL": "numpy"},
    )

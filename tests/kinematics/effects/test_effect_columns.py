"""Derivatives of the corrected centre against central differences, kind by kind."""

from dataclasses import replace

import numpy as np
import pytest

from tests.kinematics.effects.samples import (
    ARM,
    CAMPAIGN,
    EVERY_KIND,
    GEOMETRY,
    full_block,
)
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import Coupling

BLOCK = full_block(seed=7, n_samples=9)


COUPLED = replace(GEOMETRY, couplings=(Coupling(2, 1, -1.0), Coupling(5, 2, 0.5)))


def differences(effects, block, geometry=GEOMETRY):
    """Central differences, with steps that move the ball by about a micrometre."""
    analytic = columns(geometry, effects, block)
    found = np.empty_like(analytic)
    for p, value in enumerate(effects.values):
        step = 1e-3 / max(np.abs(analytic[:, :, p]).max(), 1e-6)
        if effects.parameter_names[p].endswith("phase_rad"):
            step = 1e-4  # a micrometre of the ball would be far round the lobe
        ends = []
        for sign in (1, -1):
            values = effects.values.copy()
            values[p] = value + sign * step
            changed = effects.with_values(values)
            ends.append(corrected_pose(geometry, changed, block)[0])
        found[:, :, p] = (ends[0] - ends[1]) / (2 * step)
    return analytic, found


def assert_close(analytic, found, rtol):
    scale = np.abs(analytic).max(axis=(0, 1), keepdims=True)
    assert np.all(np.abs(analytic - found) <= rtol * scale + 1e-9)


@pytest.mark.parametrize("geometry", [GEOMETRY, COUPLED], ids=["plain", "coupled"])
@pytest.mark.parametrize(
    "one", EVERY_KIND, ids=lambda one: f"{one.kind}-{one.joint or 'arm'}"
)
def test_columns_of_each_kind_are_central_differences(one, geometry):
    effects = effects_of(ARM, (one,), CAMPAIGN)
    analytic, found = differences(effects, BLOCK, geometry)
    assert analytic.shape == (9, 3, len(effects.parameter_names))
    if one.kind != "artefact_length":
        assert np.abs(analytic).max(axis=(0, 1)).min() > 0.0
    # Two small vectors of wobble do not commute: half their size is left over.
    assert_close(analytic, found, 1e-4 if one.kind == "axis_wobble" else 2e-7)


def test_columns_of_all_effects_together_are_differences_to_the_second_order():
    effects = effects_of(ARM, EVERY_KIND, CAMPAIGN)
    analytic, found = differences(effects, BLOCK)
    assert_close(analytic, found, 2e-3)


def test_candidates_that_are_not_applied_get_the_columns_of_zero_amplitude():
    candidates = effects_of(ARM, EVERY_KIND, CAMPAIGN)
    applied = effects_of(ARM, EVERY_KIND[:2], CAMPAIGN)
    found = columns(GEOMETRY, applied, BLOCK, candidates.corrections[9:12])
    both = effects_of(ARM, (*EVERY_KIND[:2], *EVERY_KIND[9:12]), CAMPAIGN)
    silent = both.with_values(np.append(applied.values, np.zeros(3)))
    np.testing.assert_array_equal(found, columns(GEOMETRY, silent, BLOCK)[:, :, 4:])


def test_amplitudes_enter_linearly_but_for_the_phase_of_lobes():
    """x - x_rigid = columns at zero times values, to the second order."""
    linear = tuple(one for one in EVERY_KIND if one.kind != "probe_lobing")
    effects = effects_of(ARM, linear, CAMPAIGN)
    none = effects.with_values(np.zeros(len(effects.values)))
    moved = corrected_pose(GEOMETRY, effects, BLOCK)[0]
    rigid = corrected_pose(GEOMETRY, none, BLOCK)[0]
    shift = columns(GEOMETRY, none, BLOCK) @ effects.values
    assert np.abs(moved - rigid).max() > 0.1
    np.testing.assert_allclose(moved - rigid, shift, atol=5e-4)


def test_free_directions_keep_the_law_of_the_kind():
    effects = effects_of(ARM, EVERY_KIND, CAMPAIGN)
    for correction in effects.corrections:
        free = correction.free_directions(GEOMETRY)
        assert free.shape[0] == len(correction.values)
        np.testing.assert_allclose(free.T @ free, np.eye(free.shape[1]), atol=1e-15)
        values = np.array(correction.values)
        np.testing.assert_allclose(free @ (free.T @ values), values, atol=1e-15)
    n_free = {
        (c.kind, *c.variety): c.free_directions(GEOMETRY).shape[1]
        for c in effects.corrections
    }
    assert n_free["axis_wobble", "2"] == n_free["axis_runout", "radial", "2"] == 4
    assert n_free["axis_runout", "axial", "1"] == 2


def test_every_kind_of_the_arm_file_is_among_the_samples():
    assert {one.kind for one in EVERY_KIND} == set(EFFECT_KINDS)

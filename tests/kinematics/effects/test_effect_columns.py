"""Derivatives of the corrected centre against central differences, kind by kind."""

from dataclasses import replace

import numpy as np
import pytest

from tests.kinematics.effects.reference import effect
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
    numeric = np.empty_like(analytic)
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
        numeric[:, :, p] = (ends[0] - ends[1]) / (2 * step)
    return analytic, numeric


def assert_close(analytic, numeric, rtol):
    scale = np.abs(analytic).max(axis=(0, 1), keepdims=True)
    assert np.all(np.abs(analytic - numeric) <= rtol * scale + 1e-9)


@pytest.mark.parametrize("geometry", [GEOMETRY, COUPLED], ids=["plain", "coupled"])
@pytest.mark.parametrize(
    "tested", EVERY_KIND, ids=lambda tested: f"{tested.kind}-{tested.joint or 'arm'}"
)
def test_columns_of_each_kind_are_central_differences(tested, geometry):
    effects = effects_of(ARM, (tested,), CAMPAIGN)
    analytic, numeric = differences(effects, BLOCK, geometry)
    assert analytic.shape == (9, 3, len(effects.parameter_names))
    if tested.kind not in ("artefact_length", "first_moment"):
        assert np.abs(analytic).max(axis=(0, 1)).min() > 0.0
    # Two small vectors of wobble do not commute: half their size is left over.
    assert_close(analytic, numeric, 1e-4 if tested.kind == "axis_wobble" else 2e-7)


def test_columns_of_all_effects_together_are_differences_to_the_second_order():
    effects = effects_of(ARM, EVERY_KIND, CAMPAIGN)
    analytic, numeric = differences(effects, BLOCK)
    assert_close(analytic, numeric, 2e-3)


def test_candidates_that_are_not_applied_get_the_columns_of_zero_amplitude():
    candidates = effects_of(ARM, EVERY_KIND, CAMPAIGN)
    applied = effects_of(ARM, EVERY_KIND[:2], CAMPAIGN)
    derivatives = columns(GEOMETRY, applied, BLOCK, candidates.corrections[9:12])
    with_candidates = effects_of(ARM, (*EVERY_KIND[:2], *EVERY_KIND[9:12]), CAMPAIGN)
    silent = with_candidates.with_values(np.append(applied.values, np.zeros(3)))
    np.testing.assert_array_equal(
        derivatives, columns(GEOMETRY, silent, BLOCK)[:, :, 4:]
    )


def test_amplitudes_enter_linearly_but_for_the_phase_of_lobes():
    """x - x_rigid = columns at zero times values, to the second order."""
    products = ("probe_lobing", "first_moment")
    linear = tuple(kind for kind in EVERY_KIND if kind.kind not in products)
    effects = effects_of(ARM, linear, CAMPAIGN)
    none = effects.with_values(np.zeros(len(effects.values)))
    moved = corrected_pose(GEOMETRY, effects, BLOCK)[0]
    rigid = corrected_pose(GEOMETRY, none, BLOCK)[0]
    shift = columns(GEOMETRY, none, BLOCK) @ effects.values
    assert np.abs(moved - rigid).max() > 0.1
    np.testing.assert_allclose(moved - rigid, shift, atol=5e-4)


def test_a_first_moment_moves_what_yields_to_it_and_nothing_else():
    (first,) = [tested for tested in EVERY_KIND if tested.kind == "first_moment"]
    for kind, joint in [("joint_compliance", "J2"), ("bearing_compliance", "J3")]:
        yielding = effect(kind, joint=joint, compliance_rad_nm=3e-6)
        effects = effects_of(ARM, (yielding, first), CAMPAIGN)
        analytic, numeric = differences(effects, BLOCK)
        # A tilt of a tenth of a milliradian does not commute with its change.
        assert_close(analytic, numeric, 2e-7 if kind == "joint_compliance" else 1e-4)
        assert np.abs(analytic[:, :, 1:]).max() > 1e-3
    beyond = effect("joint_compliance", joint="J4", compliance_rad_nm=3e-6)
    effects = effects_of(ARM, (beyond, first), CAMPAIGN)
    assert not np.any(columns(GEOMETRY, effects, BLOCK)[:, :, 1:])


def test_a_first_moment_says_the_same_as_masses():
    """Of an element with a mass at its centre and all that it carries at its end."""
    compliance = effect("joint_compliance", joint="J2", compliance_rad_nm=2e-4)
    weighed = effects_of(ARM, (compliance,), CAMPAIGN)
    levers_kg_m = 1e-3 * weighed.levers_kg_mm(GEOMETRY)
    bare = ARM.model_copy(
        update={
            "joints": tuple(
                joint.model_copy(update={"mass_kg": None, "centre_of_mass_mm": None})
                for joint in ARM.joints
            ),
            "probe": ARM.probe.model_copy(update={"mass_kg": None}),
        }
    )
    moments = tuple(
        effect("first_moment", joint=joint.name, moment_kg_m=[*lever])
        for joint, lever in zip(ARM.joints, levers_kg_m, strict=True)
    )
    stated = effects_of(bare, (compliance, *moments), CAMPAIGN)
    assert stated.levers_kg_mm(GEOMETRY) == pytest.approx(1e3 * levers_kg_m)
    found_mm, wanted_mm, plain_mm = (
        corrected_pose(GEOMETRY, effects, BLOCK)[0]
        for effects in (stated, weighed, effects_of(ARM, (), CAMPAIGN))
    )
    np.testing.assert_allclose(found_mm, wanted_mm, atol=1e-10)
    assert np.abs(wanted_mm - plain_mm).max() > 0.01


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
    assert {tested.kind for tested in EVERY_KIND} == set(EFFECT_KINDS)

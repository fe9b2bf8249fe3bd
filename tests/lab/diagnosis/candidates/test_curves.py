"""Curves without a name against direct formulas."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from tests.lab.diagnosis.candidates.test_library import chosen
from tests.lab.diagnosis.fitted_rows import measured, measured_rows
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.effects.readings.spline import spline_amounts
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import across
from traverse.lab.diagnosis.candidates.curves import (
    N_FINE_KNOTS,
    N_KNOTS,
    generic_bank,
    spline_knots,
)
from traverse.lab.diagnosis.candidates.scoring import project
from traverse.lab.diagnosis.model.candidate import effect_of_candidate
from traverse.lab.diagnosis.model.covariates import covariate_columns
from traverse.lab.diagnosis.model.fit import fitted
from traverse.lab.diagnosis.model.observation_equations import equations_of

JOINTS = [f"J{k}" for k in range(1, 8)]


def test_curves_cover_all_covariates():
    bank = generic_bank(measured_rows())
    of_arm = [candidate for candidate in bank.candidates if candidate.artefact is None]
    creeping = [
        candidate for candidate in bank.candidates if candidate.artefact is not None
    ]
    covered = {(c.joint, c.component, c.covariate) for c in of_arm}
    angles = {
        (joint, "angle", covariate)
        for joint in JOINTS
        for covariate in (
            *(f"{other}_rad" for other in JOINTS),
            "time_s",
            "temperature_c",
            "force_n",
            f"{joint}_temperature_c",
            f"{joint}_speed_rad_s",
        )
    }
    moves = {
        (joint, component, covariate)
        for joint in JOINTS
        for component in ("tilt", "shift")
        for covariate in (f"{joint}_rad", "time_s", "temperature_c")
    }
    approaches = [f"{joint}_approach" for joint in JOINTS]
    held = ["force_n", *approaches]
    base = {
        *((None, "shift", covariate) for covariate in ("time_s", "temperature_c")),
        *((None, "shift", covariate) for covariate in held),
        *(("J1", "tilt", covariate) for covariate in held),
    }
    assert covered == angles | moves | base
    fine = [
        candidate
        for candidate in bank.candidates
        if candidate.component == "angle" and candidate.size == N_FINE_KNOTS
    ]
    # The plain ones and, over the joint's own reading, the fine ones.
    assert len(of_arm) == len(covered) + len(JOINTS)
    assert [curve.artefact for curve in creeping] == [
        artefact.id for artefact in measured().campaign.artefacts
    ]
    assert {(curve.joint, curve.covariate) for curve in fine} == {
        (joint, f"{joint}_rad") for joint in JOINTS
    }
    sizes = {"angle": 1, "tilt": 2, "shift": 3}
    for candidate in of_arm:
        if candidate not in fine:
            n_knots = 2 if candidate.covariate in approaches else N_KNOTS
            assert candidate.size == n_knots * sizes[str(candidate.component)]
    assert bank.columns.shape[1] == sum(c.size for c in bank.candidates)
    assert np.isfinite(bank.columns).all()


def test_few_poses_have_no_fine_curves():
    campaign = measured().with_poses().campaign
    few = np.arange(len(campaign.poses)) % 3 == 0
    rows = equations_of(fitted(campaign, measured().arm, few).adjustment)
    assert np.count_nonzero(few) < 8 * (N_KNOTS + 1)
    assert all(
        candidate.size == N_KNOTS
        for candidate in generic_bank(rows).candidates
        if candidate.component == "angle"
    )


def test_covariates_that_do_not_vary_or_are_not_there_have_no_curves():
    n = len(measured().campaign.poses)
    campaign = measured().with_poses(
        temperature_c=np.full(n, 20.0),
        joint_temperatures_c=None,
        speeds_rad_s=np.zeros((n, 7)),
        force_n=None,
    )
    names = [course.name for course in covariate_columns(campaign.rows())]
    assert names == [*(f"{joint}_rad" for joint in JOINTS), "time_s"]


@pytest.mark.parametrize("covariate", ["J5_rad", "time_s", "J2_speed_rad_s"])
def test_a_curve_of_an_angle_is_the_effect_of_the_arm_file(covariate):
    """A natural spline by another program, applied to the readings."""
    rows = measured_rows()
    joint = "J2"
    candidate, columns = chosen(
        generic_bank(rows), joint=joint, component="angle", covariate=covariate
    )
    rng = np.random.default_rng(2)
    values = 1e-5 * rng.normal(size=candidate.size)
    keys = dict(candidate.keys)
    at = {course.name: course.values for course in covariate_columns(rows)}[covariate]
    curve = CubicSpline(keys["knots"], values, bc_type="natural")(at)
    curve = np.where(at > keys["knots"][-1], values[-1], curve)
    poses = rows.used_poses
    centred = curve - curve[poses].mean()
    geometry = rows.adjustment.state.arm.geometry
    moved = []
    for sign in (1.0, -1.0):
        angles_rad = rows.block.angles_rad.copy()
        angles_rad[:, 1] -= sign * centred
        moved.append(probe_centre(geometry, angles_rad))
    expected = rows.moved((moved[0] - moved[1])[:, :, np.newaxis] / 2)[:, 0]
    computed = columns @ (values / candidate.scales)
    np.testing.assert_allclose(computed, expected, atol=1e-6 * np.abs(expected).max())
    effect = effect_of_candidate(candidate, values, rows)
    effects = effects_of(measured().arm, (effect,), measured().campaign.span)
    centres_mm = corrected_pose(geometry, effects, rows.block)[0]
    alone = probe_centre(
        geometry, rows.block.angles_rad - curve[:, None] * np.eye(7)[1]
    )
    np.testing.assert_allclose(centres_mm, alone, atol=1e-9)


def test_tilts_and_shifts_move_what_the_joint_carries():
    """By an arm whose chain is broken at the joint and put together again."""
    rows = measured_rows()
    bank = generic_bank(rows)
    geometry = rows.adjustment.state.arm.geometry
    k, small = 3, 1e-5
    angles_rad = rows.block.angles_rad
    v, w = across(geometry.axes[k])
    frame = {"v": v, "w": w, "u": geometry.axes[k]}
    at = angles_rad[:, k]
    for component in ("tilt", "shift"):
        candidate, columns = chosen(
            bank, joint="J4", component=component, covariate="J4_rad"
        )
        knots = dict(candidate.keys)["knots"]
        curves = spline_amounts(knots, at).T
        curves -= curves[rows.used_poses].mean(axis=0)
        for column in (0, 3, 12, 19):
            key, direction, number = candidate.parameters[column].split(".")
            assert key == {"tilt": "tilt_rad", "shift": "shift_mm"}[component]
            amounts = curves[:, int(number) - 1]
            moved = [
                np.array(
                    [
                        broken(geometry, k, row, sign * small * a * frame[direction])
                        if component == "tilt"
                        else shifted(geometry, k, row, sign * a * frame[direction])
                        for row, a in zip(angles_rad, amounts, strict=True)
                    ]
                )
                for sign in (1.0, -1.0)
            ]
            expected = rows.moved((moved[0] - moved[1])[:, :, np.newaxis] / 2)[:, 0]
            # The scale of the bank: 1e-5 rad, 0.01 mm.
            expected = expected * (1.0 if component == "tilt" else 0.01)
            np.testing.assert_allclose(
                columns[:, column], expected, atol=1e-4 * np.abs(expected).max()
            )


def broken(geometry, k, angles_rad, turn_rad):
    """The joint's axis and all beyond it turned by a small vector of its carrier."""
    beyond = replace(
        geometry,
        origin_mm=np.zeros(3),
        axes=geometry.axes[k:],
        links_mm=geometry.links_mm[k:],
        zeros_rad=geometry.zeros_rad[k:],
    )
    reach_mm = probe_centre(beyond, angles_rad[None, k:])[0]
    reach_mm = reach_mm + np.cross(turn_rad, reach_mm)
    return placed(geometry, k, angles_rad, reach_mm)


def shifted(geometry, k, angles_rad, shift_mm):
    return broken(geometry, k, angles_rad, np.zeros(3)) + (
        placed(geometry, k, angles_rad, shift_mm)
        - placed(geometry, k, angles_rad, np.zeros(3))
    )


def placed(geometry, k, angles_rad, reach_mm):
    """A vector of the carrier of joint k as the last link of the joints before."""
    links_mm = geometry.links_mm[:k].copy()
    links_mm[-1] += reach_mm
    before = replace(
        geometry,
        axes=geometry.axes[:k],
        links_mm=links_mm,
        zeros_rad=geometry.zeros_rad[:k],
        probe_vector_mm=np.zeros(3),
    )
    return probe_centre(before, angles_rad[None, :k])[0]


def test_the_base_moves_in_three_directions():
    rows = measured_rows()
    candidate, columns = chosen(generic_bank(rows), joint=None, covariate="time_s")
    assert candidate.parameters[0] == "shift_mm.x.1"
    knots = dict(candidate.keys)["knots"]
    curves = spline_amounts(knots, rows.block.campaign_s).T
    curves -= curves[rows.used_poses].mean(axis=0)
    for axis in range(3):
        moves = np.zeros((len(curves), 3, N_KNOTS))
        moves[:, axis] = 0.01 * curves
        of_axis = columns[:, N_KNOTS * axis : N_KNOTS * (axis + 1)]
        np.testing.assert_allclose(of_axis, rows.moved(moves), atol=1e-12)


def test_only_curves_of_angles_have_an_entry_in_the_arm_file():
    bank = generic_bank(measured_rows())
    candidate, _ = chosen(bank, component="tilt")
    with pytest.raises(ValueError, match="no curve that moves a joint by its tilt"):
        effect_of_candidate(candidate, np.zeros(candidate.size), measured_rows())


def test_a_curve_that_is_applied_leaves_nothing_of_itself():
    rows = measured_rows()
    candidate, _ = chosen(
        generic_bank(rows), joint="J3", component="angle", covariate="J3_rad"
    )
    effect = effect_of_candidate(candidate, np.zeros(candidate.size), rows)
    again = equations_of(measured().fit((effect,)).adjustment)
    bank = generic_bank(again)
    index = bank.candidates.index(candidate)
    for at, projection in enumerate(project(again, bank)):
        assert (len(projection.singular_values) == 0) == (at == index)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=60),
    st.integers(0, 20),
)
@settings(max_examples=60)
def test_knots_rise_and_span_the_values(values, n_repeated):
    values = np.array(values + [values[0]] * n_repeated)
    if np.ptp(values) < 1e-2:
        return
    knots = spline_knots(values)
    assert 2 <= len(knots) <= N_KNOTS
    assert np.all(np.diff(knots) > 0.0)
    assert (knots[0], knots[-1]) == (values.min(), values.max())
    # Unit curves add up to one everywhere, and each is one at its own knot.
    np.testing.assert_allclose(spline_amounts(knots, values).sum(axis=0), 1.0)
    np.testing.assert_allclose(
        spline_amounts(knots, np.array(knots)), np.eye(len(knots)), atol=1e-9
    )


def test_few_different_values_have_a_knot_each():
    values = np.repeat([20.0, 20.5, 21.0, 23.0], [5, 50, 500, 2])
    assert spline_knots(values) == (20.0, 20.5, 21.0, 23.0)
    evenly = np.linspace(0.0, 9.0, 1001)
    np.testing.assert_allclose(spline_knots(evenly), np.arange(10.0))

"""The library against the whole model and simulated truth; harmonics by formula."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tests.lab.diagnosis.fitted_rows import measured, measured_rows, serial_rows
from tests.lab.simulated import arm_value, seven_joints
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.pose import corrected_pose
from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.library import absent_candidates, library_bank
from traverse.lab.diagnosis.candidates.scoring import project
from traverse.lab.diagnosis.candidates.waves import HIGHEST_HARMONIC, harmonic_bank
from traverse.lab.diagnosis.model.candidate import Bank, effect_of_candidate
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.first_moments import first_moments

NOT_LISTED = {
    "empirical",
    "count_slip",
    "base_step",
    "transmission_error",
    "first_moment",
}


def chosen(bank, **keys):
    """The first candidate with some attributes, and its columns."""
    for candidate, columns in zip(bank.candidates, bank.slices, strict=True):
        if all(getattr(candidate, key) == value for key, value in keys.items()):
            return candidate, bank.columns[:, columns]
    raise LookupError(keys)


def moved_by_differences(arm, rows, candidate, column, applied=()):
    """Central differences of the corrected pose, by a small effect of the arm file."""
    geometry = rows.adjustment.state.arm.geometry
    span = rows.adjustment.network.campaign.span
    centres_mm = []
    for sign in (1.0, -1.0):
        values = np.zeros(candidate.size)
        values[column] = sign * candidate.scales[column]
        effect = effect_of_candidate(candidate, values, rows)
        effects = effects_of(arm, (*applied, effect), span)
        centres_mm.append(corrected_pose(geometry, effects, rows.block)[0])
    moves_mm = (centres_mm[0] - centres_mm[1])[:, :, np.newaxis] / 2.0
    return rows.moved(moves_mm)[:, 0]


def test_the_library_has_every_kind_but_those_found_elsewhere():
    bank = library_bank(measured_rows(), measured().arm)
    assert {c.kind for c in bank.candidates} == set(EFFECT_KINDS) - NOT_LISTED
    # By hand: seven joints with 9 kinds, 3 orders of harmonics, wobble and radial
    # runout each, and 4 of axial runout; 7 kinds of the whole arm; the ball's radius
    # and the bar's length.
    assert len(bank.candidates) == 7 * (9 + 3 * 3 + 4) + 7 + 2
    assert bank.columns.shape == (
        len(measured_rows().values),
        sum(c.size for c in bank.candidates),
    )
    assert len({c.identity for c in bank.candidates}) == len(bank.candidates)
    assert absent_candidates(measured_rows(), measured().arm) == ()


def test_every_column_is_the_difference_of_the_whole_model():
    arm, rows = measured().arm, measured_rows()
    bank = library_bank(rows, arm)
    for candidate, part in zip(bank.candidates, bank.slices, strict=True):
        if candidate.kind == "artefact_length":
            continue
        for column in range(candidate.size):
            expected = moved_by_differences(arm, rows, candidate, column)
            size = np.abs(expected).max()
            # A turn about an axis that is nearly upright meets hardly any weight.
            assert size > 1e-3 or candidate.name == "joint_compliance J1"
            np.testing.assert_allclose(
                bank.columns[:, part][:, column],
                expected,
                atol=3e-4 * size + 1e-6,
                err_msg=candidate.name,
            )


def test_columns_stand_beside_effects_that_are_applied():
    applied = tuple(
        effect_from_table({"kind": kind, "joint": joint, **keys})
        for kind, joint, keys in (
            ("encoder_eccentricity", "J3", {"cos_rad": 4e-5, "sin_rad": -2e-5}),
            ("bearing_compliance", "J2", {"compliance_rad_nm": 1e-5}),
        )
    )
    fit = measured().fit(applied)
    rows = equations_of(fit.adjustment)
    bank = library_bank(rows, measured().arm)
    for kind in ("axis_wobble", "encoder_scale", "mount_compliance", "base_drift"):
        candidate, columns = chosen(bank, kind=kind)
        expected = moved_by_differences(
            measured().arm, rows, candidate, 0, fit.arm.effects
        )
        np.testing.assert_allclose(
            columns[:, 0], expected, atol=1e-3 * np.abs(expected).max()
        )


@pytest.mark.parametrize(
    ("keys", "sizes"),
    [
        ({"kind": "encoder_eccentricity", "joint": "J3"}, (1.0, -0.5)),
        ({"kind": "axis_wobble", "joint": "J5", "order": 2}, (1.0, -2.0, 0.5, 1.0)),
        ({"kind": "axis_runout", "joint": "J6", "component": "axial"}, (2.0, 1.0)),
        ({"kind": "base_drift"}, (1.0, -2.0, 1.5)),
        ({"kind": "probe_lobing"}, (1.5, -2.0)),
        ({"kind": "thermal_expansion", "joint": None}, (1.0,)),
        ({"kind": "joint_compliance", "joint": "J2"}, (0.5,)),
    ],
)
def test_amplitudes_of_a_simulated_effect_come_back(keys, sizes):
    rows = measured_rows()
    candidate, _ = chosen(library_bank(rows, measured().arm), **keys)
    truth = 2.0 * np.array(sizes)
    effect = effect_of_candidate(candidate, truth * candidate.scales, rows)
    assert_recovered(measured().with_effect(effect), keys, truth)


def test_an_error_of_a_standard_is_recovered():
    measurement = measured()
    campaign = measurement.campaign
    *unchanged, bar = campaign.artefacts
    wrong = bar.model_copy(update={"distance_mm": bar.distance_mm / (1 + 40e-6)})
    stated = replace(campaign, artefacts=(*unchanged, wrong))
    keys = {"kind": "artefact_length", "artefact": bar.id}
    assert_recovered(replace(measurement, campaign=stated), keys, np.array([4.0]))


def assert_recovered(measurement, keys, truth):
    """In each visible direction z is s times the truth, with unit noise."""
    rows = measurement.rows()
    candidate, columns = chosen(library_bank(rows, measurement.arm), **keys)
    (projection,) = project(rows, Bank((candidate,), columns))
    visible = projection.singular_values * (projection.combinations.T @ truth)
    noise = projection.directions.T @ rows.residuals - visible
    assert np.linalg.norm(visible) > 5.0 or candidate.kind == "artefact_length"
    assert noise @ noise < stats.chi2.isf(1e-4, len(noise))


@pytest.mark.parametrize(
    "bank_of",
    [lambda rows: library_bank(rows, measured().arm), harmonic_bank, generic_bank],
    ids=["library", "harmonics", "curves"],
)
def test_serial_correlation_is_taken_out_of_the_columns(bank_of):
    rows, serial = measured_rows(), serial_rows()
    plain, whitened = bank_of(rows).columns, bank_of(serial).columns
    np.testing.assert_allclose(
        serial.root @ whitened, plain, atol=1e-9 * np.abs(plain).max()
    )


def test_what_the_campaign_does_not_say_is_absent_with_a_reason():
    measurement = measured().with_poses(
        temperature_c=None,
        joint_temperatures_c=None,
        speeds_rad_s=None,
        directions=None,
        approaches=np.ones_like(measured().campaign.poses.approaches),
    )
    arm = arm_value(seven_joints())
    first, *further = arm.joints
    first = first.model_copy(update={"mass_kg": 1.0})
    arm = arm.model_copy(update={"joints": (first, *further)})
    rows = measurement.rows()
    reasons = {c.kind: why for c, why in absent_candidates(rows, arm)}
    assert reasons == {
        "encoder_temperature": "the block has no temperature",
        "thermal_expansion": "the block has no temperature",
        "encoder_latency": "the block has no speed",
        "backlash": "the direction of approach does not vary",
        "joint_compliance": "no mass is known from J7 outwards",
        "bearing_compliance": "no mass is known from J7 outwards",
        "probe_radius": "no direction of a touched surface is known",
        "probe_lobing": "no direction of a touched surface is known",
        "stylus_bending": "no direction of a touched surface is known",
    }
    kinds = {candidate.kind for candidate in library_bank(rows, arm).candidates}
    of_first = {"joint_compliance", "bearing_compliance"}
    assert kinds == set(EFFECT_KINDS) - NOT_LISTED - set(reasons) | of_first


def test_a_temperature_that_is_constant_says_nothing():
    n = len(measured().campaign.poses)
    measurement = measured().with_poses(
        temperature_c=np.full(n, 23.4), joint_temperatures_c=None
    )
    absent = absent_candidates(measurement.rows(), measurement.arm)
    reasons = {candidate.name: why for candidate, why in absent}
    assert reasons["thermal_expansion"] == "the temperature does not vary"
    assert len(reasons) == 7 + 8


def test_effects_are_written_in_the_form_of_the_arm_file():
    rows = measured_rows()
    bank = library_bank(rows, measured().arm)
    axis = rows.adjustment.state.arm.geometry.axes[3]
    wobble = effect_of_candidate(
        chosen(bank, kind="axis_wobble", joint="J4", order=3)[0],
        np.array([1e-5, 0.0, 0.0, 2e-5]),
        rows,
    ).values
    assert wobble["order"] == 3
    across = np.array([wobble["cos_rad"], wobble["sin_rad"]])
    np.testing.assert_allclose(across @ axis, 0.0, atol=1e-20)
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), [1e-5, 2e-5])
    np.testing.assert_allclose(np.cross(across[0], across[1]), 2e-10 * axis)
    lobing = effect_of_candidate(
        chosen(bank, kind="probe_lobing")[0], np.array([-3e-3, 4e-3]), rows
    ).values
    assert lobing["amplitude_mm"] == pytest.approx(5e-3)
    assert lobing["phase_rad"] == pytest.approx(np.pi - np.arctan(4 / 3))
    drift = effect_of_candidate(
        chosen(bank, kind="base_drift")[0], np.array([1e-6, 2e-6, 3e-6]), rows
    )
    assert drift.values["rate_mm_s"] == (1e-6, 2e-6, 3e-6)
    assert drift.epoch_utc == measured().campaign.start


def test_without_any_mass_other_moments_than_assumed_are_columns_beside():
    """Each is the change of what the compliance does by a standard deviation of one."""
    arm = arm_value(seven_joints())
    rows = measured_rows()
    bank = library_bank(rows, arm)
    compliance, columns = chosen(bank, kind="joint_compliance", joint="J3")
    assert compliance.parameters == (
        "compliance_rad_nm",
        *(f"J{number}.{axis}" for number in (3, 4, 5, 6, 7) for axis in "xyz"),
    )
    moments = first_moments(arm)
    effect = effect_of_candidate(compliance, np.array(compliance.scales), rows)
    assert effect.values == {"compliance_rad_nm": compliance.scales[0]}
    geometry = rows.adjustment.state.arm.geometry
    of_effect = effects_of(
        arm, (effect, *moments), rows.adjustment.network.campaign.span
    )
    plain_mm = corrected_pose(geometry, of_effect, rows.block)[0]
    for index, (moment, axis) in enumerate(
        [(m, a) for m in moments[2:] for a in range(3)]
    ):
        changed = np.array(moment.moment_kg_m)
        changed[axis] += compliance.scales[1 + index] / compliance.scales[0]
        other = moment.model_copy(update={"moment_kg_m": tuple(changed)})
        swapped = tuple(other if each is moment else each for each in moments)
        heavier = effects_of(arm, (effect, *swapped))
        moves_mm = corrected_pose(geometry, heavier, rows.block)[0] - plain_mm
        expected = rows.moved(moves_mm[:, :, np.newaxis])[:, 0]
        scale = np.abs(expected).max() + 1e-6
        np.testing.assert_allclose(columns[:, 1 + index], expected, atol=1e-3 * scale)


def test_harmonics_are_waves_of_the_reading():
    rows = measured_rows()
    bank = harmonic_bank(rows)
    assert len(bank.candidates) == 7 * HIGHEST_HARMONIC
    scales = {1: 3e-5, 2: 2e-5, 3: 1e-5, 4: 1e-5, 5: 5e-6, 60: 5e-6}
    for order, scale in scales.items():
        for joint in (0, 4):
            place = joint * HIGHEST_HARMONIC + order - 1
            candidate = bank.candidates[place]
            assert candidate.joint == f"J{joint + 1}"
            assert candidate.scales == (scale, scale)
            kind = "encoder_eccentricity" if order == 1 else "encoder_harmonic"
            assert (candidate.kind, candidate.order or 1) == (kind, order)
            phases_rad = order * rows.block.angles_rad[rows.poses, joint]
            waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=1)
            expected = scale * rows.by_readings[:, [joint]] * waves
            np.testing.assert_allclose(bank.columns[:, bank.slices[place]], expected)


def test_low_harmonics_are_those_of_the_library():
    rows = measured_rows()
    library, harmonics = library_bank(rows, measured().arm), harmonic_bank(rows)
    identities = {candidate.identity for candidate in library.candidates}
    shared = [c for c in harmonics.candidates if c.identity in identities]
    assert len(shared) == 7 * 4
    for harmonic in shared:
        of_library = {
            "kind": harmonic.kind,
            "joint": harmonic.joint,
            "order": harmonic.order,
        }
        same, expected = chosen(library, **of_library)
        assert (same.scales, same.log_prior) == (harmonic.scales, harmonic.log_prior)
        columns = harmonics.slices[harmonics.candidates.index(harmonic)]
        np.testing.assert_allclose(
            harmonics.columns[:, columns], expected, atol=1e-6 * np.abs(expected).max()
        )

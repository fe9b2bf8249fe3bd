"""Measured orientations of a tracker's probe on the last body.

Campaigns are the simulator's; estimates are compared with the truth, with derivatives
by differences, and with an adjustment by scipy that knows no quaternions.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.tools.handover import campaign_from_simulation
from tests.simulator.effects.examples import example, heavy_arm, spec_of
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.pose import corrected_rotations
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.model.quaternion import (
    conjugate,
    multiply,
    rotation_vectors,
)
from traverse.lab.adjustment import IdentificationError, Problem
from traverse.lab.adjustment.effect_model import effect_model
from traverse.lab.campaign.campaign_file import Tool
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.prediction import (
    mountings_of,
    places_of,
    predict,
)
from traverse.lab.identification.report.page import report_page, result_map
from traverse.simulator.campaigns import (
    Cone,
    NoiseTable,
    Points,
    draw_noise,
    make_poses,
    true_arm_file,
    with_effects,
)

ARM = heavy_arm()
QUICK = Options(coarse_start=False, n_suggestions=0)
NOISE = NoiseTable(encoder_rad=5e-6, contact_mm=0.02, orientation_rad=5e-5)
RARE = 1e-3
N_DRAWS = 10
TURNING = (
    "encoder_eccentricity",
    "encoder_harmonic",
    "encoder_scale",
    "encoder_temperature",
    "encoder_drift",
    "backlash",
    "encoder_latency",
    "joint_compliance",
    "bearing_compliance",
    "mount_compliance",
    "axis_wobble",
)
STAYING = ("thermal_expansion", "axis_runout", "base_drift")
# What an effect acts on: a reading, a bearing, a joint, the base, an axis.
ONE_OF_A_CLASS = (
    "encoder_eccentricity",
    "bearing_compliance",
    "joint_compliance",
    "mount_compliance",
    "axis_wobble",
)


def tracker(n_poses=120, **more):
    values = {"id": "tracker", "n_points": n_poses, "size_mm": 450.0}
    return Points(n_poses=n_poses, orientations=True, **{**values, **more})


@cache
def poses(n_poses=120):
    return make_poses(ARM, spec_of(tracker(n_poses)), 3)


def measured(seed, noise=NOISE, of=None):
    drawn = draw_noise(poses() if of is None else of, seed, noise)
    return campaign_from_simulation(drawn.campaign), drawn.truth


def without(campaign):
    return campaign.with_poses(orientations=None)


def stds_of(result):
    return {entry.name: entry.std for entry in result.parameters}


@pytest.mark.slow
def test_sigma0_is_near_one_and_standard_deviations_are_right():
    tests, sums = [], []
    for seed in range(N_DRAWS):
        campaign, truth = measured(seed)
        result = identify(campaign, ARM, QUICK)
        assert result.converged
        assert result.undetermined == ()
        tests.append(result.sigma0**2 * result.redundancy)
        sums.append(turn_misfit(result, truth))
        assert result.redundancy == 6 * 120 - 25 - 3 - 6
    low, high = chi2.ppf([RARE, 1 - RARE], N_DRAWS * 686)
    assert low < np.sum(tests) < high
    low, high = chi2.ppf([RARE, 1 - RARE], N_DRAWS * 2)
    assert low < np.sum(sums) < high


def turn_misfit(result, truth):
    """How far the axis of J7 is from where it is in the instrument's probe.

    M^-1 u_7 depends on no datum and no base posture. A chi-square of two degrees.
    """
    state = result.adjustment.state.arm
    names = [entry.name for entry in result.parameters]
    at = [names.index(f"probe.mounting.{axis}") for axis in "xyz"]
    at += [names.index(f"J7.axis.{part}") for part in "vw"]
    network = result.adjustment.network
    basis = network.parameters.basis(state.geometry)[-1]
    axis = state.geometry.axes[-1]
    back = Rotation.from_quat(state.mountings[0], scalar_first=True).as_matrix().T
    # d(M^-1 u) = M^-1 (u x m + du)
    slopes = back @ np.column_stack([np.cross(axis, np.eye(3)).T, basis.T])
    covariance = slopes @ result.covariance[np.ix_(at, at)] @ slopes.T
    miss = back @ axis - truth.mounting.T @ truth.arm.mechanism.axes[-1]
    return float(miss @ np.linalg.pinv(covariance, rcond=1e-6) @ miss)


def test_orientations_make_the_last_axis_ten_times_better_known():
    campaign, _ = measured(1)
    result = identify(campaign, ARM, QUICK)
    bare = identify(without(campaign), ARM, QUICK)
    both, positions = stds_of(result), stds_of(bare)
    assert set(both) - set(positions) == {f"probe.mounting.{a}" for a in "xyz"}
    assert all(both[name] < positions[name] for name in positions)
    for name in ("J7.axis.v", "J7.axis.w", "J7.link.v", "J7.link.w"):
        assert 10.0 * both[name] < positions[name]
    assert result.orientations.sigma0["orientations"] == pytest.approx(1.0, abs=0.15)
    assert result.orientations.rms_after_rad == pytest.approx(5e-5, rel=0.1)
    assert result.orientations.rms_before_rad > 20 * result.orientations.rms_after_rad
    assert bare.orientations is None


def test_what_positions_do_not_determine_orientations_do():
    """A marker on the last axis: that turns, and the ball stays."""
    probe = ARM.probe.model_copy(update={"vector_mm": (0.0, 0.0, 0.0)})
    joints = list(ARM.joints)
    last = joints[-1]
    along = tuple(150.0 * component for component in last.axis)
    joints[-1] = last.model_copy(update={"link_mm": along})
    arm = ARM.model_copy(update={"joints": tuple(joints), "probe": probe})
    spec = spec_of(tracker(60, size_mm=300.0))
    of = make_poses(arm, spec, 4)
    campaign, _ = measured(2, of=of)
    bare = identify(without(campaign), arm, QUICK)
    result = identify(campaign, arm, QUICK)
    assert result.undetermined == ()
    directions = [entry.direction for entry in (*bare.undetermined, *bare.weak)]
    names = {name for direction in directions for name in direction}
    assert any(name.startswith(("J6.axis", "J7.axis")) for name in names)


def test_derivatives_are_those_of_differences():
    """Of every parameter, the frame and the mounting, with effects that are free."""
    effects = [example(kind) for kind in ("encoder_eccentricity", "axis_wobble")]
    played = with_effects(poses(), effects)
    campaign, _ = measured(3, of=played)
    arm = ARM.model_copy(update={"effects": played.effects})
    options = replace(QUICK, free=("*",))
    problem = Problem.of(campaign, arm, options)
    parameters = problem.parameters
    some = np.zeros(len(campaign.poses), dtype=np.bool_)
    some[::6] = True
    network = problem.network(some)
    state = network.start(problem.design)
    (station,), (unknowns,) = network.stations, state.unknowns
    (rows,) = network.white_rows(station, state.arm, unknowns)
    free = parameters.free_names
    steps = 1e-6 * np.array(
        [1e3 if unit == "mm" else 1 for unit in parameters.free_units]
    )

    def white_at(arm, of_station):
        misclosures = network.all_misclosures(station, arm, of_station)
        return (rows.whiteners @ misclosures[:, :, None])[:, :, 0]

    for k, name in enumerate(free):
        step = np.zeros(len(free))
        step[k] = steps[k]
        ends = [
            white_at(parameters.moved(state.arm, s * step), unknowns) for s in (1, -1)
        ]
        slope = (ends[0] - ends[1]) / (2 * steps[k])
        size = np.abs(slope).max()
        # Effects: how they change with others is left out of the columns.
        away = np.abs(rows.by_parameters[:, :, k] - slope).max()
        assert away < 3e-3 * size + 1e-6, name
    for k in range(len(station.scales)):
        step = np.zeros(len(station.scales))
        step[k] = 1e-6
        moved = station.artefact.moved
        ends = [white_at(state.arm, moved(unknowns, s * step)) for s in (1, -1)]
        slope = (ends[0] - ends[1]) / 2e-6
        assert rows.by_unknowns[:, :, k] == pytest.approx(
            slope, abs=1e-6 * np.abs(slope).max()
        )


@pytest.mark.parametrize("kind", [*TURNING, *STAYING])
def test_effects_turn_the_last_body_as_differences_say(kind):
    campaign, _ = measured(1)
    effect = with_effects(poses(), (example(kind),)).effects[0]
    model = effect_model(ARM, (effect,), campaign)
    geometry, block = geometry_from_arm(ARM), campaign.block()
    values = model.effects.values
    turns = columns(geometry, model.effects, block, turns=True)
    for k in range(len(values)):
        step = np.zeros(len(values))
        step[k] = 1e-3 * max(np.abs(values).max(), 1e-9)
        ends = [
            corrected_rotations(geometry, model.at(values + s * step), block)
            for s in (1, -1)
        ]
        turned = rotation_vectors(multiply(ends[0], conjugate(ends[1])))
        slope = turned / (2 * step[k])
        assert turns[:, :, k] == pytest.approx(
            slope.T, abs=2e-3 * np.abs(slope).max() + 3e-9
        )
    assert bool(np.any(turns)) == (kind in TURNING)


@pytest.mark.parametrize("kind", ONE_OF_A_CLASS)
def test_an_effect_that_is_held_undoes_what_the_simulator_plays(kind):
    played = with_effects(poses(60), (example(kind),))
    quiet = NoiseTable(encoder_rad=0.0, contact_mm=0.0, orientation_rad=0.0)
    campaign, _ = measured(1, noise=quiet, of=played)
    campaign = replace(
        campaign, encoder_rad=1e-6, contact_mm=1e-3, orientation_rad=1e-5
    )
    arm = true_arm_file(ARM, played.truth)
    options = replace(QUICK, hold=("J*", "origin.*"))
    largest = []
    for effects in (played.effects, ()):
        result = identify(
            campaign, arm.model_copy(update={"effects": effects}), options
        )
        largest.append(result.orientations.rms_all_rad)
    assert largest[0] < 1e-7
    assert largest[1] > 3e-6


@pytest.mark.slow
def test_an_orientation_that_is_a_blunder_is_taken_out_alone():
    spoilt = NOISE.model_copy(
        update={"blunder_share": 0.05, "blunder_kinds": ("orientation", "contact")}
    )
    campaign, truth = measured(5, noise=spoilt)
    result = identify(campaign, ARM, QUICK)
    lines = {
        kind: [blunder.line for blunder in truth.blunders if blunder.kind == kind]
        for kind in ("orientation", "contact")
    }
    assert min(map(len, lines.values())) > 0
    assert [entry.line for entry in result.orientations.excluded] == lines[
        "orientation"
    ]
    assert [entry.line for entry in result.excluded] == lines["contact"]
    assert {entry.part for entry in result.excluded} == {"position"}
    assert all(10 < entry.w < 20 for entry in result.orientations.excluded)
    page = report_page(result, result_map(result))
    assert "<th>contradicts</th>" in page
    assert "<td>position</td>" in page
    assert "Orientations that contradict the rest" in page
    assert result.orientations.rms_all_rad > 1.5 * result.orientations.rms_after_rad


def test_inverse_rotations_are_refused_with_the_remedy():
    campaign, _ = measured(1)
    backwards = campaign.poses.orientations * [1.0, -1.0, -1.0, -1.0]
    turned = campaign.with_poses(orientations=backwards)
    with pytest.raises(IdentificationError, match="change the signs"):
        identify(turned, ARM, QUICK)


@pytest.mark.slow
def test_components_in_another_order_leave_the_result_in_doubt():
    campaign = measured(1)[0].part(np.arange(120) % 3 == 0)
    rolled = np.roll(campaign.poses.orientations, -1, axis=1)
    wrong = campaign.with_poses(orientations=rolled)
    result = identify(wrong, ARM, QUICK)
    assert result.converged
    assert len(result.orientations.excluded) > 36
    page = report_page(result, result_map(result))
    assert "orientations contradict the positions and were left out" in page
    assert "(w, x, y, z)" in page
    # Positions are as good as without.
    bare = stds_of(identify(without(campaign), ARM, QUICK))
    stds = stds_of(result)
    assert stds["J2.link.v"] == pytest.approx(bare["J2.link.v"], rel=0.1)


@pytest.mark.parametrize("frame", ["arm", "own_scaled"])
def test_orientations_are_in_the_frame_of_their_points(frame):
    scale = 1.0005 if frame == "own_scaled" else 1.0
    of = make_poses(ARM, spec_of(tracker(100, frame=frame, scale=scale)), 3)
    campaign, _ = measured(3, of=of)
    result = identify(campaign, ARM, QUICK)
    assert result.converged
    assert result.orientations.excluded == ()
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high
    # Angles give no length.
    is_scale = [direction.is_scale for direction in result.undetermined]
    assert is_scale == [True] * (scale != 1.0)


def test_each_tool_has_a_mounting_of_its_own():
    """Every second pose with a probe that is turned by a known rotation."""
    campaign, _ = measured(9)
    other = np.arange(120) % 2
    known = Rotation.from_rotvec([0.3, -1.2, 0.7])
    seen = Rotation.from_quat(campaign.poses.orientations, scalar_first=True)
    turned = (seen * known).as_quat(scalar_first=True)
    both = np.where(other[:, None] > 0, turned, campaign.poses.orientations)
    poses = replace(campaign.poses, orientations=both, tools=other)
    tool = Tool(name="second", vector_mm=ARM.probe.vector_mm)
    result = identify(replace(campaign, poses=poses, tools=(tool,)), ARM, QUICK)
    assert result.converged
    assert result.excluded == ()
    assert result.orientations.excluded == ()
    mountings = result.orientations.mountings
    first, second = (
        Rotation.from_quat(mountings[name].quaternion, scalar_first=True)
        for name in ("probe", "second")
    )
    stds = [*mountings["probe"].std_rad, *mountings["second"].std_rad]
    away = (second * (first * known).inv()).magnitude()
    assert away < 5.0 * np.linalg.norm(stds)
    assert {"tool.second.mounting.z", "tool.second.x"} <= set(stds_of(result))
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high


def test_noise_that_is_not_stated_is_estimated():
    campaign, _ = measured(6, NOISE.model_copy(update={"stated": False}))
    result = identify(campaign, ARM, QUICK)
    assert result.global_test.noise_estimated
    assert result.noise.orientation_rad == pytest.approx(5e-5, rel=0.15)
    assert result.noise.contact_mm[0] == pytest.approx(0.02, rel=0.15)
    stated = replace(campaign, orientation_rad=5e-5)
    assert identify(stated, ARM, QUICK).noise.orientation_rad == 5e-5


def test_poses_without_orientations_and_cones_take_part_beside_the_others():
    spec = spec_of(tracker(90), Cone(id="cone", n_poses=30))
    campaign, _ = measured(7, of=make_poses(ARM, spec, 3))
    orientations = campaign.poses.orientations.copy()
    assert np.all(np.isnan(orientations[campaign.poses.artefacts == 1]))
    orientations[::3] = np.nan
    # The sign of a quaternion says nothing.
    orientations[1::3] *= -1.0
    campaign = campaign.with_poses(orientations=orientations)
    result = identify(campaign, ARM, QUICK)
    assert result.converged
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high
    used = result.orientations.used
    assert np.array_equal(used, campaign.poses.oriented)
    n_rows = 3 * 120 + 3 * np.count_nonzero(used)
    assert result.redundancy == n_rows - 25 - 3 - 6 - 3


def test_orientations_of_poses_kept_aside_are_predicted():
    campaign, _ = measured(8)
    kept = np.zeros(120, dtype=np.bool_)
    kept[::4] = True
    result = identify(campaign.part(~kept), ARM, QUICK)
    kept_aside = campaign.part(kept)
    prediction = predict(
        kept_aside, result.arm, places_of(result), result.tools_mm, mountings_of(result)
    )
    figures = prediction.figures()["orientation"]
    assert figures["n"] == 30
    # Three components of 5e-5 rad, and what the arm is not known.
    assert figures["rms_rad"] == pytest.approx(5e-5 * np.sqrt(3.0), rel=0.25)
    assert figures["rms_deg"] == pytest.approx(np.degrees(figures["rms_rad"]))
    assert figures["mean_rad"] < figures["rms_rad"] < figures["largest_rad"]
    # By themselves they fit at least as well.
    itself = predict(kept_aside, result.arm, {}).figures()["orientation"]
    assert itself["rms_rad"] < figures["rms_rad"]
    predicted = predict(kept_aside, ARM, places_of(result)).figures()["orientation"]
    assert predicted["rms_rad"] > 20 * figures["rms_rad"]

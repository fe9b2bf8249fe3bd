"""Effects in an adjustment: applied as they are, held or free, refused where blind."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.tools.handover import campaign_from_simulation
from tests.simulator.effects.examples import START, TABLES, example, heavy_arm, spec_of
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.effects.base.context import utc_ns
from traverse.lab.adjustment import IdentificationError, Problem
from traverse.lab.adjustment.effect_model import effect_model
from traverse.lab.identification.identify import Options, identify
from traverse.simulator.campaigns import (
    BallBar,
    Cone,
    NoiseTable,
    ParallelPlanes,
    Sphere,
    draw_noise,
    make_poses,
    true_arm_file,
    with_effects,
)

ARM = heavy_arm()
SPEC = spec_of(
    Cone(id="cone-1", n_poses=45),
    Cone(id="cone-2", n_poses=45),
    Sphere(id="ball", n_poses=40, radius_mm=25.0),
    BallBar(id="bar", n_poses=50, radius_mm=12.7, distance_mm=500.0),
    BallBar(id="short", n_poses=50, radius_mm=12.7, distance_mm=300.0),
)
LOUD = NoiseTable(encoder_rad=5e-6, contact_mm=0.003)
QUIET = NoiseTable(encoder_rad=0.0, contact_mm=0.0, direction_rad=0.0)
CERTIFIED_MM = 0.0005
LENGTH = {"kind": "artefact_length", "error_ppm": 0.0}
GAUGE = ParallelPlanes(
    id="gauge",
    n_poses=60,
    distance_mm=150.0,
    distance_std_mm=CERTIFIED_MM,
    size_mm=60.0,
)
OPTIONS = Options(coarse_start=False, n_suggestions=0)


@cache
def rigid():
    return make_poses(ARM, SPEC, 3)


def campaign_with(*effects, noise=LOUD, seed=1):
    simulated = campaign_from_simulation(
        draw_noise(with_effects(rigid(), effects), seed, noise).campaign
    )
    return replace(simulated, encoder_rad=5e-6, contact_mm=0.003)


def true_arm(poses, effects):
    """The true geometry, with some effects."""
    arm = true_arm_file(ARM, poses.truth)
    return arm.model_copy(update={"effects": tuple(effects)})


def network_of(campaign, arm, options=OPTIONS):
    problem = Problem.of(campaign, arm, options)
    network = problem.network()
    return network, network.start(problem.design)


@pytest.mark.parametrize("kind", TABLES)
def test_an_effect_that_is_held_undoes_what_the_simulator_plays(kind):
    poses = with_effects(rigid(), (example(kind),))
    campaign = campaign_with(example(kind), noise=QUIET)
    network, state = network_of(campaign, true_arm(poses, poses.effects))
    assert not any(network.parameters.free[-len(network.parameters.effects.names) :])
    assert network.rms_mm(state) < 2e-5
    if kind not in ("artefact_length", "first_moment"):  # which move nothing
        network, state = network_of(campaign, true_arm(poses, ()))
        assert network.rms_mm(state) > 1e-3


def test_a_standard_is_as_long_as_its_certificate_and_its_error_say():
    wrong = example("artefact_length", artefact="short", error_ppm=80.0)
    campaign = campaign_with(wrong, noise=QUIET)
    campaign = with_certificates(campaign)
    for effects, expected_mm in (((wrong,), 0.0), ((), 80e-6 * 300.0)):
        network, state = network_of(campaign, true_arm(rigid(), effects))
        for station, unknowns in zip(network.stations, state.unknowns, strict=True):
            whitened = network.certified(station, state.arm, unknowns)[:, -1]
            found_mm = CERTIFIED_MM * np.abs(whitened).sum()
            named = station.artefact.id == "short"
            assert found_mm == pytest.approx(expected_mm if named else 0.0, abs=1e-5)


def with_certificates(campaign):
    """The lengths of both bars are certified, to a tenth of a micrometre or so."""
    artefacts = tuple(
        artefact.model_copy(update={"distance_std_mm": CERTIFIED_MM})
        if artefact.kind == "ball_bar"
        else artefact
        for artefact in campaign.artefacts
    )
    return replace(campaign, artefacts=artefacts)


def freed(campaign, arm, *patterns, **options):
    return identify(campaign, arm, replace(OPTIONS, free=patterns, **options))


def design(*tables):
    effects = tuple(effect_from_table(table) for table in tables)
    return ARM.model_copy(update={"effects": effects})


def test_an_effect_that_is_freed_is_estimated():
    true = example("encoder_eccentricity")
    unknown = {
        "kind": "encoder_eccentricity",
        "joint": "J4",
        "cos_rad": 0,
        "sin_rad": 0,
    }
    result = freed(campaign_with(true), design(unknown), "J4.encoder_eccentricity.*")
    (effect,) = result.arm.effects
    names = [parameter.name for parameter in result.parameters]
    stds = {parameter.name: parameter.std for parameter in result.parameters}
    for key in ("cos_rad", "sin_rad"):
        name = f"J4.encoder_eccentricity.{key}"
        away = effect.values[key] - true.values[key]
        assert abs(away) < 4.0 * stds[name] < 3e-5
    assert names[-2:] == [
        f"J4.encoder_eccentricity.{k}" for k in ("cos_rad", "sin_rad")
    ]
    assert result.sigma0 == pytest.approx(1.0, abs=0.15)


def test_an_effect_that_is_held_stays_as_the_file_has_it():
    true = example("encoder_eccentricity", cos_rad=5e-5, sin_rad=-3e-5)
    arm = ARM.model_copy(update={"effects": (true,)})
    result = freed(campaign_with(true), arm)
    assert result.arm.effects == (true,)
    assert result.sigma0 == pytest.approx(1.0, abs=0.15)
    assert not any("encoder" in parameter.name for parameter in result.parameters)
    without = freed(campaign_with(true), ARM, snooping=False)
    assert without.sigma0 > 1.3


def test_the_covariance_names_every_key_and_holds_what_is_held():
    tables = [{"kind": kind, **TABLES[kind]} for kind in ("axis_wobble", "base_drift")]
    played = [effect_from_table(table) for table in tables]
    result = freed(campaign_with(*played), design(*tables), "base_drift.*")
    names = result.cartesian.names
    covariance = result.cartesian.covariance
    assert (
        covariance.shape
        == (len(names), len(names))
        == (len(result.cartesian.values),) * 2
    )
    effects = [name for name in names if "wobble" in name or "drift" in name]
    assert effects == [
        *(f"J3.axis_wobble.2.{k}_rad.{c}" for k in ("cos", "sin") for c in "xyz"),
        *(f"base_drift.rate_mm_s.{c}" for c in "xyz"),
    ]
    for name in effects:
        variance = covariance[names.index(name), names.index(name)]
        assert (variance > 0.0) == ("drift" in name)
    at = names.index("base_drift.rate_mm_s.x")
    assert result.cartesian.values[at] == result.arm.effects[1].values["rate_mm_s"][0]


def test_vectors_of_a_wobble_stay_across_the_axis():
    true = example("axis_wobble", cos_rad=[0.0, 6e-5, -5e-5], sin_rad=[0.0, 2e-5, 6e-5])
    played = with_effects(rigid(), (true,)).effects[0]
    table = {"kind": "axis_wobble", "joint": "J3", "order": 2}
    zero = {"cos_rad": [0.0] * 3, "sin_rad": [0.0] * 3}
    result = freed(campaign_with(true), design({**table, **zero}), "*wobble*")
    (effect,) = result.arm.effects
    axis = np.array(result.arm.joints[2].axis)
    start = np.array(ARM.joints[2].axis)
    assert np.linalg.norm(axis - start) > 1e-4
    names = [parameter.name for parameter in result.parameters]
    assert names[-4:] == [
        f"J3.axis_wobble.2.{key}.{c}" for key in ("cos_rad", "sin_rad") for c in "vw"
    ]
    std = max(parameter.std for parameter in result.parameters[-4:])
    for key in ("cos_rad", "sin_rad"):
        assert abs(np.dot(effect.values[key], axis)) < 1e-18 + 1e-9 * std
        away = np.subtract(effect.values[key], played.values[key])
        assert np.linalg.norm(away) < 6.0 * std


def test_a_vector_that_leans_is_brought_across_the_axis():
    leaning = {"cos_rad": [3e-5, 0.0, -5e-5], "sin_rad": [0.0, 2e-5, 6e-5]}
    table = {"kind": "axis_wobble", "joint": "J3", "order": 2, **leaning}
    result = freed(campaign_with(), design(table), "*wobble*")
    axis = result.arm.joints[2].axis
    for key in ("cos_rad", "sin_rad"):
        assert np.dot(result.arm.effects[0].values[key], axis) == pytest.approx(
            0.0, abs=1e-15
        )


def test_a_wrong_standard_is_estimated_beside_another():
    wrong = example("artefact_length", artefact="short", error_ppm=150.0)
    campaign = with_certificates(campaign_with(wrong))
    result = freed(
        campaign, design({**LENGTH, "artefact": "short"}), "artefact_length.*"
    )
    (parameter,) = [
        p for p in result.parameters if p.name.startswith("artefact_length")
    ]
    value_ppm = result.arm.effects[0].values["error_ppm"]
    assert abs(value_ppm - 150.0) < 4.0 * parameter.std
    assert 1.0 < parameter.std < 15.0
    assert parameter.unit == "ppm"
    assert result.sigma0 == pytest.approx(1.0, abs=0.15)


def test_balls_of_a_bar_say_a_little_about_its_length():
    wrong = example("artefact_length", artefact="short", error_ppm=150.0)
    campaign = with_certificates(campaign_with(wrong))
    keep = campaign.poses.artefacts != [a.id for a in campaign.artefacts].index("bar")
    alone = replace(campaign, poses=campaign.poses.part(np.flatnonzero(keep)))
    result = freed(alone, design({**LENGTH, "artefact": "short"}), "artefact_length.*")
    (parameter,) = [
        p for p in result.parameters if p.name.startswith("artefact_length")
    ]
    assert abs(result.arm.effects[0].values["error_ppm"] - 150.0) < 4.0 * parameter.std
    # 25 contacts of some micrometres on each, 12.7 + 3 mm from the middle.
    assert 20.0 < parameter.std < 100.0


def test_the_only_length_of_a_campaign_cannot_be_wrong():
    cones = (Cone(id=f"cone-{n}", n_poses=40) for n in (1, 2))
    spec = spec_of(*cones, GAUGE)
    wrong = example("artefact_length", artefact="gauge", error_ppm=150.0)
    poses = with_effects(make_poses(ARM, spec, 3), (wrong,))
    campaign = campaign_from_simulation(draw_noise(poses, 1, LOUD).campaign)
    guess = {**LENGTH, "artefact": "gauge", "error_ppm": 7.0}
    result = freed(campaign, design(guess), "artefact_length.*")
    # The arm has grown instead; what is held is near the guess, not near the truth.
    assert result.arm.effects[0].values["error_ppm"] == pytest.approx(7.0, abs=20.0)
    names = [
        name for combination in result.undetermined for name in combination.direction
    ]
    assert any(name.startswith("artefact_length") for name in names)


def test_what_the_campaign_does_not_tell_is_refused_all_at_once():
    campaign = campaign_with()
    blind = campaign.with_poses(temperature_c=None, speeds_rad_s=None)
    tables = [
        {"kind": kind, **TABLES[kind]}
        for kind in ("encoder_temperature", "encoder_latency", "encoder_scale")
    ]
    with pytest.raises(IdentificationError) as refused:
        identify(blind, design(*tables), OPTIONS)
    refusal = str(refused.value)
    assert "J1.encoder_temperature needs the temperature" in refusal
    assert "encoder_latency needs the speed" in refusal
    assert "encoder_scale" not in refusal
    assert "add the columns or take the effects out of the arm file" in refusal


def test_times_before_the_start_are_times_of_the_campaign():
    campaign = campaign_with(example("base_drift"))
    first_s = campaign.poses.time_s.min()
    shifted = campaign.with_poses(time_s=campaign.poses.time_s - first_s - 60.0)
    start, end = shifted.span
    assert (START - start).total_seconds() == pytest.approx(60.0, abs=0.01)
    assert (end - start).total_seconds() == pytest.approx(
        np.ptp(campaign.poses.time_s), abs=0.01
    )
    table = {"kind": "base_drift", **TABLES["base_drift"]}
    model = effect_model(ARM, (effect_from_table(table),), shifted)
    block = model.campaign.block()
    assert block.utc_ns.min() == utc_ns(START) - 60 * 10**9
    later = freed(shifted, design(table), "base_drift.*")
    plain = freed(campaign, design(table), "base_drift.*")
    # Where the whole arm was at the epoch is no part of the rate.
    for rate, other in zip(
        later.arm.effects[0].values["rate_mm_s"],
        plain.arm.effects[0].values["rate_mm_s"],
        strict=True,
    ):
        assert rate == pytest.approx(other, abs=1e-7)


def test_a_campaign_without_a_start_has_one_all_the_same():
    campaign = replace(campaign_with(), start_utc=None)
    start, end = campaign.span
    assert end > start
    table = {"kind": "encoder_drift", "joint": "J2", "rate_rad_s": 0.0}
    result = freed(campaign, design({**table, "epoch_utc": start}), "*drift*")
    (parameter,) = [p for p in result.parameters if "drift" in p.name]
    assert abs(parameter.value) < 4.0 * parameter.std < 1e-7


def test_coordinates_say_the_step_that_was_taken():
    tables = [{"kind": k, **TABLES[k]} for k in ("axis_wobble", "encoder_eccentricity")]
    problem = Problem.of(campaign_with(), design(*tables), OPTIONS)
    values, parameters = problem.design, problem.parameters
    parameters = parameters.with_free(np.ones(len(parameters.names), dtype=np.bool_))
    step = 1e-7 * np.random.default_rng(2).normal(size=len(parameters.names))
    moved = parameters.moved(values, step)
    np.testing.assert_allclose(
        parameters.coordinates(moved, values), step, atol=1e-4 * 1e-7 + 1e-10
    )
    assert len(moved.amplitudes) == 6 + 2

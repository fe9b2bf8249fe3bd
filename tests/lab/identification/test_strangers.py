"""Arms of other makers: slow convergence, wrong certificates, unknown tools."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.identification.words import said
from tests.lab.simulated import (
    DESIGN_ARM,
    Noise,
    bar,
    built,
    cones,
    disturbed,
    seen_places,
    seven_joints,
    simulate,
)
from traverse.lab.identification.identify import Options, identify

DESIGN = seven_joints()
BALL = {"id": "ball", "kind": "sphere", "radius_mm": 25.4}
GAUGE = {"id": "gauge", "kind": "parallel_planes", "distance_mm": 100.0}
SHORT = bar(id="short")
LONG = bar(id="long", distance_mm=500.0)
LONGEST = bar(id="longest", distance_mm=800.0)
GRID = {
    "id": "grid",
    "kind": "points",
    "frame": "own",
    "points_mm": {
        name: np.random.default_rng(at).uniform(-150.0, 150.0, 3).tolist()
        for at, name in enumerate("ABCDEFGH")
    },
}
QUICK = Options(n_suggestions=0)


def identified(tables, n_each=50, options=QUICK, seed=1, arm=None, **more):
    """An arm as identified, and what is said first about artefacts and noise."""
    true = built(seed) if arm is None else arm
    campaign = simulate(true, tables, n_each, seed, **more.pop("simulated", {}))
    for key, value in more.pop("lies", {}).items():
        changed = [
            artefact.model_copy(update=value) if artefact.id == key else artefact
            for artefact in campaign.artefacts
        ]
        campaign = replace(campaign, artefacts=tuple(changed))
    result = identify(replace(campaign, **more), DESIGN_ARM, options)
    return result, said(result)


def tracked(seed, n_poses, travel_rad, noise):
    """Follow the ball of a true arm with a tracker: every pose is a known point."""
    rng = np.random.default_rng(seed)
    true = built(seed)
    turns = rng.uniform(-1.0, 1.0, (n_poses, 7)) * travel_rad
    angles_rad = true.zeros_rad + turns
    read_rad = angles_rad + rng.normal(size=angles_rad.shape) * noise.encoder_rad
    centres_mm = true.centres(read_rad)
    centres_mm += rng.normal(size=centres_mm.shape) * noise.contact_mm
    return seen_places(angles_rad, centres_mm, encoder_rad=1e-5, contact_mm=0.02)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("free", [(), ("*.zero",)])
def test_a_campaign_that_determines_little_converges(seed, free):
    rough = Noise(3e-4, 0.2)
    campaign = tracked(seed, 40, (0.2, 0.5)[seed % 2], rough)
    result = identify(campaign, DESIGN_ARM, replace(QUICK, free=free))
    words = said(result)
    assert result.converged, words
    assert "units" not in words
    assert result.rms_after_mm < 0.5
    # The first zero turns the arm as a whole: it belongs to the datum.
    assert "J1.zero" not in {entry.name for entry in result.parameters}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tables", "lie", "wrong_mm", "value_mm", "noise_known"),
    [
        ([*cones(3), BALL], "ball.radius_mm", 254.0, 25.4, False),
        ([*cones(2), SHORT, LONG], "short.distance_mm", 404.0, 400, True),
        ([*cones(2), SHORT, LONGEST], "longest.distance_mm", 80.0, 800, True),
        ([*cones(2), SHORT, LONG], "short.radius_mm", 13.7, 12.7, False),
        ([*cones(2), LONG, GAUGE], "gauge.distance_mm", 101.0, 100, True),
    ],
)
def test_a_wrong_certificate_is_named_with_its_value(
    tables, lie, wrong_mm, value_mm, noise_known
):
    artefact, key = lie.split(".")
    noise = {} if noise_known else {"encoder_rad": None, "contact_mm": None}
    lies = {artefact: {key: wrong_mm}}
    result, words = identified(tables, 72, lies=lies, **noise)
    (contradiction,) = result.contradictions
    assert (contradiction.artefact, contradiction.length) == (artefact, key)
    assert contradiction.certified_mm == wrong_mm
    # Without another length the arm keeps the design's scale.
    close = 5.0 * contradiction.std_mm if tables[-1] is not BALL else 0.01 * value_mm
    assert contradiction.value_mm == pytest.approx(value_mm, abs=close)
    assert result.converged
    assert len(result.excluded) <= 2
    assert f"The certificate of {artefact} contradicts" in words
    assert "Arm model and noise agree" not in words


@pytest.mark.parametrize("tables", [[*cones(3), LONG], [*cones(2), LONG, BALL]])
def test_a_good_certificate_is_not_blamed_for_an_arm_held_wrong(tables):
    links = DESIGN.links_mm.copy()
    links[-2:] += [[0.5, -1.0, 0.4], [1.0, 0.3, -0.8]]
    true = disturbed(replace(DESIGN, links_mm=links), 2)
    options = replace(QUICK, hold=("J6.*", "J7.*"))
    result, words = identified(tables, 50, options, arm=true)
    assert not result.contradictions
    assert "certificate" not in words
    assert "Arm model and noise agree" not in words


def test_an_artefact_that_loses_many_poses_is_in_the_verdict():
    design = built(1)
    campaign = simulate(design, [*cones(4), bar()], 40, 3)
    moved = campaign.poses.angles_rad.copy()
    moved[28:40, 0] += 0.01
    campaign = campaign.with_poses(angles_rad=moved)
    result = identify(campaign, DESIGN_ARM, QUICK)
    assert [entry.artefact for entry in result.lost_poses] == ["cone-0"]
    assert not result.artefacts_agree
    words = said(result)
    assert "cone-0 lost 12 of 40 poses, more than a fifth" in words
    assert "Arm model and noise agree" not in words


def test_a_free_tool_is_found_before_zeros_are_looked_for():
    links = DESIGN.links_mm.copy()
    links[-1] += [30.0, 90.0, -120.0]
    true = disturbed(replace(DESIGN, links_mm=links), 0)
    options = replace(QUICK, free=("probe.vector.*",))
    result, _ = identified([GRID], 60, options, 0, arm=true)
    assert result.rms_before_mm > 20.0
    assert result.converged
    assert not np.any(result.zero_offsets_rad)
    assert result.rms_after_mm < 0.02


@pytest.mark.slow
def test_zeros_that_are_held_by_wish_are_never_moved():
    zeros = DESIGN.zeros_rad + np.array([0, 0.6, 0, 0.5, 0, 0, 0])
    true = disturbed(replace(DESIGN, zeros_rad=zeros), 3)
    tables = [*cones(3), bar()]
    options = replace(QUICK, hold=("*.zero",))
    held, _ = identified(tables, 15, options, arm=true)
    assert not np.any(held.zero_offsets_rad)
    assert [joint.zero_rad for joint in held.arm.joints] == DESIGN.zeros_rad.tolist()
    options = replace(QUICK, hold=("J2.zero",))
    held_at_j2, _ = identified(tables, 15, options, arm=true)
    assert held_at_j2.zero_offsets_rad[1] == 0.0

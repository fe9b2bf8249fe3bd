"""Arms that nobody here made: slow ways, unknown tools."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.simulated import (
    Noise,
    arm_value,
    bar,
    cones,
    disturbed,
    seven_joints,
    simulate,
)
from traverse.lab.artefacts import artefact_from_table
from traverse.lab.campaign.campaign import Campaign, Poses
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.report.page import WORDS

DESIGN = seven_joints()
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


def tracked(seed, n_poses, travel_rad, noise):
    """Follow the ball of a true arm with a tracker: every pose is a known point."""
    rng = np.random.default_rng(seed)
    true = disturbed(DESIGN, seed)
    turns = rng.uniform(-1.0, 1.0, (n_poses, 7)) * travel_rad
    angles_rad = true.zeros_rad + turns
    read_rad = angles_rad + rng.normal(size=angles_rad.shape) * noise.encoder_rad
    centres_mm = true.centres(read_rad)
    centres_mm += rng.normal(size=centres_mm.shape) * noise.contact_mm
    names = tuple(f"P{at}" for at in range(n_poses))
    table = {
        "id": "tracker",
        "kind": "points",
        "frame": "own",
        "points_mm": dict(zip(names, centres_mm.tolist(), strict=True)),
    }
    return Campaign(
        artefacts=(artefact_from_table(table),),
        feature_names=(names,),
        joint_names=tuple(f"J{k + 1}" for k in range(7)),
        poses=Poses(
            lines=np.arange(2, n_poses + 2),
            time_s=np.arange(n_poses, dtype=float),
            artefacts=np.zeros(n_poses, dtype=np.int64),
            features=np.arange(n_poses),
            angles_rad=angles_rad,
        ),
        encoder_rad=1e-5,
        contact_mm=0.02,
    )


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("free", [(), ("*.zero",)])
def test_a_campaign_that_determines_little_converges(seed, free):
    rough = Noise(3e-4, 0.2)
    campaign = tracked(seed, 40, (0.2, 0.5)[seed % 2], rough)
    result = identify(campaign, arm_value(DESIGN), replace(QUICK, free=free))
    words = " ".join(WORDS.lines("sigma0", result))
    assert result.converged, words
    assert "units" not in words
    assert result.rms_after_mm < 0.5
    # The first zero turns the arm as a whole: it belongs to the datum.
    assert "J1.zero" not in {entry.name for entry in result.parameters}


@pytest.mark.parametrize("seed", range(3))
def test_a_free_tool_is_found_before_zeros_are_looked_for(seed):
    links = DESIGN.links_mm.copy()
    links[-1] += [30.0, 90.0, -120.0]
    true = disturbed(replace(DESIGN, links_mm=links), seed)
    options = replace(QUICK, free=("probe.vector.*",))
    result = identify(simulate(true, [GRID], 60, seed), arm_value(DESIGN), options)
    assert result.rms_before_mm > 20.0
    assert result.converged
    assert not np.any(result.zero_offsets_rad)
    assert result.rms_after_mm < 0.02


def test_zeros_that_are_held_by_wish_are_never_moved():
    zeros = DESIGN.zeros_rad + np.array([0, 0.6, 0, 0.5, 0, 0, 0])
    true = disturbed(replace(DESIGN, zeros_rad=zeros), 3)
    campaign = simulate(true, [*cones(3), bar()], 50, 1)
    options = replace(QUICK, hold=("*.zero",))
    held = identify(campaign, arm_value(DESIGN), options)
    assert not np.any(held.zero_offsets_rad)
    assert [joint.zero_rad for joint in held.arm.joints] == DESIGN.zeros_rad.tolist()
    options = replace(QUICK, hold=("J2.zero",))
    one = identify(campaign, arm_value(DESIGN), options)
    assert one.zero_offsets_rad[1] == 0.0

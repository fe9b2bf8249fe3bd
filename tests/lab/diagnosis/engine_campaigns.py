"""Campaigns with hidden effects, by the simulator's physics, for whole diagnoses."""

import numpy as np

from benchmarks.blind.detectable_sizes import SizeScale, noise_free_campaign, ruler
from benchmarks.blind.hidden.poses import (
    Hidden,
    campaign_spec,
    drawn,
    played,
    weighed,
)
from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.handover import campaign_from_simulation
from tests.shared import shared
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.diagnose import DiagnosisOptions, diagnose
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    Cone,
    NoiseTable,
    PoseSet,
    Sphere,
    draw_noise,
    make_poses,
)

SEED = 1
OPTIONS = DiagnosisOptions(seed=SEED, n_draws=200)
DECISION = DiagnosisOptions(seed=SEED, n_draws=200, details=False)
NOISE = NoiseTable(encoder_rad=5e-6, contact_mm=0.003)


def bar(name: str, distance_mm: float, n_poses: int) -> BallBar:
    return BallBar(
        id=name,
        n_poses=n_poses,
        radius_mm=12.7,
        distance_mm=distance_mm,
        distance_std_mm=0.0005,
    )


@shared
def poses(two_bars: bool = False) -> PoseSet:
    """Poses of three cones, a sphere, a bar or two."""
    bars = (bar("bar", 500.0, 50),)
    if two_bars:
        bars = (*bars, bar("short", 300.0, 50))
    spec = CampaignSpec(
        artefacts=(
            *(Cone(id=f"cone-{number}", n_poses=50) for number in (1, 2, 3)),
            Sphere(id="ball", n_poses=45, radius_mm=25.0),
            *bars,
        ),
        noise=NOISE,
        conditions=campaign_spec().conditions,
    )
    return make_poses(weighed(demo_arm()), spec, SEED)


@shared
def measure(two_bars: bool = False) -> SizeScale:
    measured = poses(two_bars)
    choosing, _ = split(noise_free_campaign(measured), SEED)
    return ruler(measured, measured.arm, choosing)


@shared
def hidden(kind: str, size: float, joint: str | None = None, draw: int = 7) -> Hidden:
    """Draw something wrong of a kind in a size of sqrt(lambda)."""
    scale = measure(kind == "artefact_length")
    rng = np.random.default_rng(draw)
    for _ in range(100):
        effect = drawn(rng, scale.poses, kind)
        if joint is not None and effect.joint != joint:
            continue
        sized = scale.sized(effect, size)
        if sized is not None:
            return sized
    raise LookupError(f"no {kind} moves these poses by {size}")


def measured_with(*wrong: Hidden, seed: int = 11, **noise: float) -> Campaign:
    """Measure with an arm that has these effects."""
    two_bars = any(effect.kind == "artefact_length" for effect in wrong)
    table = NOISE.model_copy(update=noise)
    return campaign_from_simulation(
        draw_noise(played(poses(two_bars), wrong), seed, table).campaign
    )


@shared
def decided(kind: str, size: float, joint: str | None = None) -> Diagnosis:
    """Decide on a campaign with one thing wrong, with the masses of the arm known."""
    return diagnose(measured_with(hidden(kind, size, joint)), poses().arm, DECISION)

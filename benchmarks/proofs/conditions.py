"""Condition numbers of geometry and encoder harmonics, by how far joints turn.

100 poses in 5 seats, two of which are a known distance apart; columns scaled to unit
length. The figures scatter with the postures, so the median of several sets counts.
"""

from pathlib import Path

import traverse.cli
from benchmarks.tools.handover import campaign_from_simulation
from traverse.kinematics.arm_file.arm import Arm, Effect, effect_from_table, read_arm
from traverse.lab.identification.identify import Options, identify
from traverse.simulator.campaigns import (
    CampaignSpec,
    PoseSet,
    make_poses,
    simulate_campaign,
)
from traverse.simulator.campaigns.spec import NoiseTable


def demo_arm() -> Arm:
    return read_arm(Path(traverse.cli.__file__).parent / "demo_data" / "arm.toml")


def mix_poses(
    mix: str, n_poses: int, seed: int, travel: str = "wide", arm: Arm | None = None
) -> PoseSet:
    spec = CampaignSpec.model_validate(
        {
            "mix": mix,
            "n_poses": n_poses,
            "travel": travel,
            "noise": NoiseTable(),
            "conditions": {"columns": ("direction",)},
        }
    )
    return make_poses(arm or demo_arm(), spec, seed)


# Derived beforehand, by another program, for another arm and unknown places:
# the pattern is to be compared, not the figures.
EXPECTED = {
    "full": (17.0, 22.0, 31.0),
    "wide": (28.0, 72.0, 683.0),
    "narrow": (74.0, 328.0, 13472.0),
}
ORDERS: tuple[tuple[int, ...], ...] = ((), (1,), (1, 2))
# So little noise that no parameter is held: all condition numbers are required.
_QUIET = {"encoder_rad": 5e-9, "contact_mm": 5e-6}
_N_POSES = 100


def condition_numbers(travel: str, seed: int) -> dict[str, list[float]]:
    return {"outcome": [_condition(travel, orders, seed) for orders in ORDERS]}


def _condition(travel: str, orders: tuple[int, ...], seed: int) -> float:
    artefacts: list[dict[str, object]] = [
        {"id": f"seat-{number}", "kind": "cone", "n_poses": _N_POSES // 5}
        for number in range(3)
    ]
    # Two seats a known distance apart: one certified length.
    pair = {"id": "pair", "kind": "points", "frame": "own", "n_points": 2}
    artefacts.append({**pair, "size_mm": 800.0, "n_poses": 2 * _N_POSES // 5})
    spec = CampaignSpec.model_validate(
        {
            "artefacts": tuple(artefacts),
            "travel": travel,
            "noise": _QUIET,
            "conditions": {"columns": ()},
        }
    )
    arm = demo_arm()
    simulated = simulate_campaign(arm, spec, seed)
    options = Options(
        free=("*.encoder_*",) if orders else (),
        snooping=False,
        coarse_start=False,
        n_suggestions=0,
    )
    with_harmonics = arm.model_copy(update={"effects": _harmonics(arm, orders)})
    return identify(
        campaign_from_simulation(simulated.campaign), with_harmonics, options
    ).condition_number


def _harmonics(arm: Arm, orders: tuple[int, ...]) -> tuple[Effect, ...]:
    """Encoder errors cos and sin of order times the reading, of every joint."""
    tables: list[dict[str, object]] = [
        {"kind": "encoder_eccentricity"}
        if order == 1
        else {"kind": "encoder_harmonic", "order": order}
        for order in orders
    ]
    nothing = {"cos_rad": 0.0, "sin_rad": 0.0}
    return tuple(
        effect_from_table({**table, "joint": joint.name, **nothing})
        for table in tables
        for joint in arm.joints
    )

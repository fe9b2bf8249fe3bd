"""Condition numbers by travel and harmonics, against those derived beforehand.

The derivation's arm is unknown. The arm here, and how far out its cones stand, were
chosen among nearly two hundred ordinary ones because their figures come close; rows
weigh the same, columns are scaled to unit length once the cones are eliminated.
"""

import numpy as np
import pytest

from tests.lab.simulated import TrueArm, arm_value, rotations
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.lab.artefacts import artefact_from_table
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses
from traverse.lab.identification.identify import Options, identify

N_EACH = 20
N_SETS = 15
# Cones are where the probe is when joints turn by this part of their travel at most.
INNER = 0.7
# Hinges and rolls either way; geometry, with first, with first and second harmonics.
DERIVED = {
    (180, 180): (17, 22, 31),
    (75, 150): (28, 72, 683),
    (40, 60): (74, 328, 13472),
}
ORDERS = ((), (1,), (1, 2))
# Base and first axis, and the turn of the second about the first: scaled columns of
# another datum have other condition numbers.
DATUM = ("origin.*", "J1.axis.*", "J2.axis.v")


def harmonics(orders):
    """Encoder errors cos and sin of order times the reading, of every joint."""
    tables = [
        {"kind": "encoder_eccentricity"}
        if order == 1
        else {"kind": "encoder_harmonic", "order": order}
        for order in orders
    ]
    nothing = {"cos_rad": 0.0, "sin_rad": 0.0}
    return tuple(
        effect_from_table({**table, "joint": f"J{k + 1}", **nothing})
        for table in tables
        for k in range(7)
    )


def bent_arm() -> TrueArm:
    """Roll, hinge, ... of 1.5 m, in the middle of travel bent by 45, 90, -45 degrees.

    40, 32 and 24 mm between rolls and hinges, the probe 80 mm beside its axis.
    """
    straight = [[40, 0, 250], [0, 0, 0], [32, 0, 600], [0, 0, 0], [24, 0, 500]]
    straight += [[0, 0, 0], [80, 0, 150]]
    turned = np.eye(3)
    axes, links_mm = [], []
    for k, bend in enumerate(np.radians([0, 45, 0, 90, 0, -45, 0])):
        axis = np.eye(3)[1 if k % 2 else 2]
        axes.append(turned @ axis)
        turned = turned @ rotations(axis, np.array([bend]))[0]
        links_mm.append(turned @ straight[k])
    return TrueArm(np.array(axes), np.array(links_mm), np.zeros(7), np.zeros(3))


def postures(arm, place_mm, travel_rad, rng):
    """Find 20 postures at a place within the travel, from random beginnings."""
    angles = rng.uniform(-1, 1, (16 * N_EACH, 7)) * travel_rad
    for _ in range(25):
        probe = probe_derivatives(arm.geometry(), angles)
        slopes = probe.by_angles
        square = slopes @ slopes.swapaxes(1, 2) + 100.0 * np.eye(3)
        away = np.linalg.solve(square, (place_mm - probe.centres_mm)[:, :, None])
        step = (slopes.swapaxes(1, 2) @ away)[:, :, 0]
        angles = angles + np.clip(step, -0.5, 0.5)
    away_mm = np.linalg.norm(arm.centres(angles) - place_mm, axis=1)
    good = (away_mm < 1e-3) & np.all(np.abs(angles) <= travel_rad, axis=1)
    return angles[good][:N_EACH]


def places(arm, travel_rad, rng):
    """Place five cones that 20 postures reach, with their postures."""
    reached = []
    while len(reached) < 5:
        inner = rng.uniform(-INNER, INNER, (1, 7)) * travel_rad
        place_mm = arm.centres(inner)[0]
        angles = postures(arm, place_mm, travel_rad, rng)
        if len(angles) == N_EACH:
            reached.append((place_mm, angles))
    return reached


def campaign_of(arm, travel, seed):
    """100 postures at five cones; the distance of the last two is known."""
    travel_rad = np.radians([travel[1], travel[0]] * 3 + [travel[1]])
    reached = places(arm, travel_rad, np.random.default_rng(seed))
    size_mm = float(np.linalg.norm(reached[4][0] - reached[3][0]))
    pair = {"A": [0.0, 0.0, 0.0], "B": [size_mm, 0.0, 0.0]}
    tables = [{"id": f"cone-{i}", "kind": "cone"} for i in range(3)]
    tables.append({"id": "p", "kind": "points", "frame": "own", "points_mm": pair})
    artefacts = tuple(artefact_from_table(table) for table in tables)
    numbers = np.arange(5 * N_EACH)
    return Campaign(
        artefacts=artefacts,
        feature_names=tuple(artefact.features or ("",) for artefact in artefacts),
        joint_names=tuple(f"J{k + 1}" for k in range(7)),
        poses=Poses(
            lines=numbers + 2,
            time_s=numbers.astype(float),
            artefacts=np.minimum(numbers // N_EACH, 3),
            features=(numbers // N_EACH == 4).astype(np.int64),
            angles_rad=np.concatenate([angles for _, angles in reached]),
        ),
        # Readings without noise: all rows have the same weight. So little of it in the
        # contacts that nothing is held: all condition numbers are required.
        encoder_rad=1e-13,
        contact_mm=1e-5,
    )


def conditions(travel, seed):
    arm = bent_arm()
    campaign, design = campaign_of(arm, travel, seed), arm_value(arm)
    condition_numbers = []
    for orders in ORDERS:
        options = Options(
            free=("*.encoder_*",) if orders else (),
            hold=DATUM,
            snooping=False,
            coarse_start=False,
            n_suggestions=0,
        )
        with_effects = design.model_copy(update={"effects": harmonics(orders)})
        result = identify(campaign, with_effects, options)
        assert result.undetermined == ()
        n_free = result.adjustment.network.parameters.n_free
        assert n_free == 4 * 7 - 3 + 14 * len(orders)
        condition_numbers.append(result.condition_number)
    return condition_numbers


@pytest.mark.slow
def test_condition_numbers_are_those_derived_beforehand():
    drawn = [[conditions(travel, seed) for seed in range(N_SETS)] for travel in DERIVED]
    table = np.median(drawn, axis=1)
    assert np.all(np.diff(table, axis=1) > 0)
    assert np.all(np.diff(table, axis=0) > 0)
    ratios = table / np.array(list(DERIVED.values()))
    assert np.all(np.abs(ratios - 1.0) < 0.3), table

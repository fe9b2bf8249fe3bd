"""Which poses are kept aside."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import measured
from tests.lab.simulated import bar, cones, seven_joints, simulate
from traverse.lab.campaign.holdout import (
    MOST_CHOOSING,
    at_most,
    split,
    split_artefacts,
)


def test_three_poses_in_ten_of_every_artefact_are_held_out():
    campaign = measured().campaign
    choosing, held_out = split(campaign, 1)
    assert np.array_equal(choosing, ~held_out)
    for index in range(len(campaign.artefacts)):
        mine = campaign.poses.artefacts == index
        assert 0.25 <= np.mean(held_out[mine]) <= 0.35


def test_held_out_poses_are_whole_groups_in_time():
    campaign = measured().campaign
    _, held_out = split(campaign, 1)
    for index in range(len(campaign.artefacts)):
        mine = np.flatnonzero(campaign.poses.artefacts == index)
        mine = mine[np.argsort(campaign.poses.time_s[mine])]
        # 40 poses in 10 groups of 4, 3 of which are held out.
        groups = held_out[mine].reshape(10, 4)
        assert np.array_equal(groups.all(axis=1), groups.any(axis=1))
        assert np.count_nonzero(groups.all(axis=1)) == 3


def test_the_order_of_the_file_does_not_matter_but_the_seed_does():
    campaign = measured().campaign
    order = np.random.default_rng(0).permutation(len(campaign.poses))
    _, held_out = split(campaign, 4)
    _, shuffled = split(campaign.part(order), 4)
    assert np.array_equal(shuffled, held_out[order])
    assert np.array_equal(split(campaign, 4)[1], held_out)
    assert not np.array_equal(split(campaign, 5)[1], held_out)


@pytest.mark.parametrize("seed", range(8))
def test_every_sphere_of_a_bar_keeps_enough_poses(seed):
    campaign = simulate(seven_joints(), [*cones(3), bar()], 16, 2)
    choosing, _ = split(campaign, seed)
    of_bar = campaign.poses.artefacts == 3
    for feature in (0, 1):
        touched = campaign.poses.features == feature
        assert np.count_nonzero(choosing & of_bar & touched) >= 6


def test_an_artefact_with_few_poses_gives_none():
    campaign = simulate(seven_joints(), [*cones(3), bar()], 20, 2)
    poses = campaign.poses
    kept = (poses.artefacts < 3) | (np.cumsum(poses.artefacts == 3) <= 12)
    campaign = campaign.part(kept)
    _, held_out = split(campaign, 1)
    assert not np.any(held_out[campaign.poses.artefacts == 3])
    assert np.any(held_out[campaign.poses.artefacts == 0])


def test_a_campaign_that_hardly_determines_the_arm_gives_none():
    # 12 poses are 36 equations: 28 for the arm, 6 for two cones.
    campaign = simulate(seven_joints(), cones(2), 6, 2)
    assert not np.any(split(campaign, 1)[1])


def test_poses_at_the_same_time_are_separated_by_their_readings():
    campaign = measured().campaign
    campaign = campaign.with_poses(time_s=np.zeros(len(campaign.poses)))
    order = np.random.default_rng(1).permutation(len(campaign.poses))
    assert np.array_equal(
        split(campaign.part(order), 1)[1], split(campaign, 1)[1][order]
    )


@pytest.mark.parametrize("part", [0.1, 0.5])
def test_another_part_is_held_out_where_it_is_requested(part):
    campaign = measured().campaign
    _, held_out = split(campaign, 1, part)
    assert abs(np.mean(held_out) - part) < 0.06


@pytest.mark.parametrize("seed", range(4))
def test_whole_artefacts_are_held_out_and_one_is_kept(seed):
    campaign = measured().campaign
    touched = campaign.poses.artefacts
    choosing, held_out = split_artefacts(campaign, seed, 0.3)
    assert np.array_equal(choosing, ~held_out)
    assert not set(touched[choosing]) & set(touched[held_out])
    assert 0.1 < np.mean(held_out) < 0.5
    assert np.any(split_artefacts(campaign, seed, 0.9)[0])
    alone = campaign.part(touched == 0)
    assert not np.any(split_artefacts(alone, seed, 0.3)[1])


def test_of_many_poses_so_many_choose_of_all_artefacts_alike():
    short = measured().campaign
    n_times = 20
    poses = short.poses.part(np.tile(np.arange(len(short.poses)), n_times))
    campaign = replace(short, poses=poses)
    choosing, held_out = split(campaign, seed=1)
    chosen = at_most(campaign, choosing, seed=1)
    assert np.count_nonzero(choosing) > MOST_CHOOSING
    assert not np.any(chosen & ~choosing)
    assert not np.any(chosen & held_out)
    assert np.count_nonzero(chosen) == pytest.approx(MOST_CHOOSING, rel=0.01)
    part = np.bincount(poses.artefacts[chosen]) / np.bincount(poses.artefacts[choosing])
    assert part == pytest.approx(part.mean(), rel=0.02)
    np.testing.assert_array_equal(chosen, at_most(campaign, choosing, seed=1))
    few, _ = split(short, seed=1)
    np.testing.assert_array_equal(few, at_most(short, few, seed=1))

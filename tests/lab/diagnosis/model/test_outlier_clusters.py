"""Poses that were left out: together, or as chance would have it."""

from dataclasses import replace
from functools import cache
from itertools import combinations
from math import comb

import numpy as np
import pytest

from tests.lab.diagnosis.engine_campaigns import (
    DECISION,
    SEED,
    hidden,
    measured_with,
    poses,
)
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.covariates import outlier_cluster
from traverse.lab.diagnosis.model.fit import fitted
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.report.files import WORDS, report_page
from traverse.lab.diagnosis.report.outcome import diagnosis_json
from traverse.lab.diagnosis.report.pictures import plots_of
from traverse.lab.statistics.outlier_clusters import lowest_log_p

N_DRAWS = 300


@cache
def scene():
    """Rows of a clean campaign and the poses for choosing."""
    campaign = measured_with()
    choosing, _ = split(campaign, SEED)
    return equations_of(fitted(campaign, poses().arm, choosing).adjustment), choosing


def place_of(left_out):
    rows, choosing = scene()
    return outlier_cluster(rows, choosing, choosing & ~left_out, N_DRAWS, 1)


def some(mask, n, seed):
    drawn = np.zeros_like(mask)
    drawn[np.random.default_rng(seed).choice(np.flatnonzero(mask), n, False)] = True
    return drawn


@pytest.mark.parametrize("n", [3, 5, 9, 17])
def test_poses_at_random_are_no_cluster(n):
    _, choosing = scene()
    assert not any(place_of(some(choosing, n, seed)) for seed in range(25))


@pytest.mark.parametrize("n_blunders", [0, 6])
def test_poses_at_one_angle_are_reported_with_joint_and_place(n_blunders):
    rows, choosing = scene()
    reading = rows.block.angles_rad[:, 2]
    at_angle = choosing & (np.abs(reading - 0.4) < 0.12)
    place = place_of(at_angle | some(choosing, n_blunders, 5))
    assert (place.covariate, place.joint) == ("J3_rad", "J3")
    assert place.low == reading[at_angle].min()
    assert place.high == reading[at_angle].max()
    assert place.n_excluded == place.n_poses == at_angle.sum()
    assert place.log_p < np.log(1e-3)


def test_the_last_poses_are_reported_by_time():
    rows, choosing = scene()
    times_s = rows.block.campaign_s
    late = choosing & (times_s > np.sort(times_s[choosing])[-7])
    place = place_of(late)
    assert (place.covariate, place.joint) == ("time_s", None)
    assert place.high == times_s[choosing].max()


def test_poses_of_one_artefact_are_reported_by_its_name():
    rows, choosing = scene()
    campaign = rows.adjustment.network.campaign
    mine = choosing & (campaign.poses.artefacts == 1)
    place = place_of(some(mine, int(mine.sum() // 2), 3))
    assert (place.covariate, place.artefact) == ("artefact", campaign.artefacts[1].id)
    assert place.n_poses == mine.sum()
    assert np.isnan(place.low)


def test_two_poses_are_never_a_cluster():
    rows, choosing = scene()
    reading = np.where(choosing, rows.block.angles_rad[:, 0], np.inf)
    assert place_of(np.isin(np.arange(len(reading)), np.argsort(reading)[:2])) is None


def test_the_scan_is_that_of_all_windows_counted_one_by_one():
    rng = np.random.default_rng(4)
    n_poses, n_out = 30, 6
    lines = [rng.normal(size=n_poses), rng.normal(size=n_poses)]
    artefacts = rng.integers(0, 3, n_poses)
    draws = np.array([rng.choice(n_poses, n_out, False) for _ in range(5)])

    def tail(k, n):
        """At least k of n poses are among those left out, by counting."""
        ways = sum(
            comb(n_out, i) * comb(n_poses - n_out, n - i)
            for i in range(k, min(n, n_out) + 1)
            if n - i <= n_poses - n_out
        )
        return ways / comb(n_poses, n)

    for draw, log_p in zip(draws, lowest_log_p(lines, artefacts, draws), strict=True):
        p_values = [1.0]
        for values in lines:
            out = values[draw]
            for low, high in combinations(np.sort(out), 2):
                inside = np.count_nonzero((values >= low) & (values <= high))
                count = np.count_nonzero((out >= low) & (out <= high))
                if count >= 3:
                    p_values.append(tail(count, inside))
        for index in range(3):
            count = np.count_nonzero(artefacts[draw] == index)
            p_values.append(tail(count, np.count_nonzero(artefacts == index)))
        assert log_p == pytest.approx(np.log(min(p_values)), abs=1e-9)


@cache
def narrow():
    """A fault of J2 narrower than any curve can follow."""
    wrong = hidden("bump", 30.0, "J2", 2)
    fault = replace(wrong.fault, half_width_rad=0.1, height_rad=3e-4)
    campaign = measured_with(replace(wrong, fault=fault))
    return fault, diagnose(campaign, poses().arm, DECISION)


def test_what_stays_excluded_at_one_angle_is_never_clean():
    fault, diagnosis = narrow()
    assert diagnosis.verdict == "unknown"
    (term,) = diagnosis.terms
    assert (term.candidate.joint, term.candidate.covariate) == ("J2", "J2_rad")
    assert term.effect is None
    assert not term.accepted
    assert diagnosis.adapted.effects == ()
    assert abs(term.cluster.low - fault.middle_rad) < 0.1
    assert abs(term.cluster.high - fault.middle_rad) < 0.1


def test_the_place_is_reported_in_words_and_files():
    _, diagnosis = narrow()
    place = diagnosis.terms[0].cluster
    low, high = np.degrees([place.low, place.high])
    (words,) = WORDS.lines("missing", diagnosis)
    assert f"where the reading of J2 is {low:.4g} to {high:.4g} degrees" in words
    (terms,) = diagnosis_json(diagnosis)["terms"]
    assert (terms["kind"], terms["joint"]) == ("empirical", "J2")
    assert terms["covariate"] == "J2_rad"
    assert terms["poses"] == {
        "low": place.low,
        "high": place.high,
        "excluded": place.n_excluded,
        "all": place.n_poses,
    }
    page = report_page(diagnosis, plots_of(diagnosis))
    assert page.count("contradict all others lie together") >= 1

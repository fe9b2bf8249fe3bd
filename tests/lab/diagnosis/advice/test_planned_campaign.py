"""What a campaign would show, before anything is measured."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.diagnosis.fitted_rows import measured, measured_rows
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.advice.minimal_detectable import (
    detectable,
    planned,
    planned_equations,
)
from traverse.lab.diagnosis.candidates.library import library_bank

SLIPPING = {
    "kind": "encoder_eccentricity",
    "joint": "J3",
    "cos_rad": 8e-5,
    "sin_rad": -8e-5,
}


def minima(sizes):
    return {
        size.candidate.name: size.minimum.value
        for size in sizes
        if size.minimum is not None
    }


def test_the_plan_says_what_the_measured_campaign_says():
    before = minima(planned(measured().campaign, measured().arm))
    rows = measured_rows()
    after = minima(detectable(rows, library_bank(rows, measured().arm)))
    sigma = np.sqrt(rows.sum_of_squares / rows.redundancy)
    # The axis of J1 was estimated a little tilted: a trace of gravity about it.
    assert after.keys() - before.keys() <= {"joint_compliance J1"}
    ratios = np.array([sigma * before[name] / after[name] for name in before])
    assert np.quantile(ratios, [0.05, 0.95]) == pytest.approx(1.0, abs=0.05)


def test_misclosures_are_not_looked_at():
    rows = planned_equations(measured().campaign, measured().arm)
    assert not np.any(rows.values)
    wrong = measured().with_effect(effect_from_table(SLIPPING))
    before = minima(planned(measured().campaign, measured().arm))
    after = minima(planned(wrong.campaign, wrong.arm))
    for name, minimum in before.items():
        assert after[name] == pytest.approx(minimum, rel=0.03)


def test_twice_the_noise_needs_twice_the_size():
    campaign = measured().campaign
    noisy = replace(
        campaign,
        encoder_rad=2.0 * campaign.encoder_rad,
        contact_mm=2.0 * campaign.contact_mm,
    )
    before = minima(planned(campaign, measured().arm))
    after = minima(planned(noisy, measured().arm))
    for joint in ("J1", "J3", "J5"):
        name = f"encoder_eccentricity {joint}"
        assert after[name] == pytest.approx(2.0 * before[name], rel=0.02)


def test_an_effect_of_the_arm_is_estimated_too():
    arm = measured().arm.model_copy(update={"effects": (effect_from_table(SLIPPING),)})
    by_name = {size.candidate.name: size for size in planned(measured().campaign, arm)}
    assert by_name["encoder_eccentricity J3"].minimum is None
    assert by_name["encoder_eccentricity J1"].minimum is not None

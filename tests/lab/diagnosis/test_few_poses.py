"""Campaigns with hardly any poses: a report or a true sentence, never a traceback."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from tests.lab.diagnosis.engine_campaigns import OPTIONS, measured_with, poses
from tests.lab.identification.words import said
from traverse.kinematics.arm_file.arm import write_arm
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.campaign import Campaign, campaign_of_places
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.report.files import summary_lines, write_diagnosis
from traverse.lab.diagnosis.report.outcome import outcome_of
from traverse.lab.identification.identify import identify
from traverse.lab.identification.report.page import WORDS
from traverse.lab.outcomes.base import State

pytestmark = pytest.mark.slow

REFUSAL = r"leave \d equations beyond the unknowns .*; measure more poses"
MOST_REFUSED = 8


def every(step: int, *, stated: bool = True) -> Campaign:
    """Take each so-manieth pose of a campaign with ball bar, sphere and cones."""
    campaign = measured_with()
    if not stated:
        campaign = replace(campaign, encoder_rad=None, contact_mm=None)
    return campaign.part(np.arange(0, len(campaign.poses), step))


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("step", [4, 8, 12, 20, 40])
def test_few_poses_give_a_report_or_a_reason(tmp_path, step, stated):
    arm, campaign = poses().arm, every(step, stated=stated)
    write_arm(tmp_path / "arm.toml", arm)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if step > MOST_REFUSED:
            with pytest.raises(IdentificationError, match=REFUSAL):
                diagnose(campaign, arm, OPTIONS)
            return
        diagnosis = diagnose(campaign, arm, OPTIONS)
        write_diagnosis(tmp_path / "out", diagnosis, tmp_path / "arm.toml")
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000
    lines = summary_lines(diagnosis)
    unproven = any(line.startswith("No poses were kept aside") for line in lines)
    reason = any(line.startswith("No pose could be kept aside") for line in lines)
    has_picture = (tmp_path / "out" / "ledger.png").exists()
    assert has_picture == bool(np.any(diagnosis.held_out))
    assert has_picture != unproven
    assert has_picture != reason
    assert has_picture or outcome_of(diagnosis).state is not State.GOOD


def test_poses_that_are_nearly_the_same_are_called_so():
    varied = measured_with()
    posture_rad = varied.poses.angles_rad[:1]
    rng = np.random.default_rng(1)
    angles_rad = posture_rad + 1e-4 * rng.standard_normal(varied.poses.angles_rad.shape)
    campaign = varied.with_poses(angles_rad=angles_rad)
    with pytest.raises(IdentificationError, match="nearly the same: no joint turned"):
        diagnose(campaign, poses().arm, OPTIONS)


def test_many_terms_may_be_requested():
    # With each term some others have nothing left to explain.
    options = replace(OPTIONS, most_terms=10, details=False)
    diagnosis = diagnose(every(2, stated=False), poses().arm, options)
    assert diagnosis.verdict in ("clean", "named", "tentative", "unknown")


@pytest.mark.parametrize("step", [12, 20])
def test_noise_that_could_not_be_estimated_is_called_assumed(step):
    result = identify(every(step, stated=False), poses().arm)
    assert not result.global_test.noise_estimated
    assert WORDS.noise(result).startswith("Noise (assumed):")
    assert "by construction" not in said(result)
    if result.redundancy <= 0:
        assert result.global_test.passed is None


@pytest.mark.parametrize(("travel_rad", "codes"), [(2.0, ()), (2e-3, ("determined",))])
def test_an_arm_whose_joints_hardly_turned_is_in_doubt(travel_rad, codes):
    """Seen by an instrument, whatever the last three joints do."""
    arm = poses().arm
    rng = np.random.default_rng(3)
    angles_rad = rng.uniform(-2.0, 2.0, (60, 7))
    angles_rad[:, 4:] *= travel_rad / 2.0
    places_mm = probe_centre(geometry_from_arm(arm), angles_rad)
    places_mm += rng.normal(0.0, 0.01, places_mm.shape)
    campaign = campaign_of_places(
        [joint.name for joint in arm.joints],
        angles_rad,
        places_mm,
        encoder_rad=1e-6,
        contact_mm=0.01,
    )
    diagnosis = diagnose(campaign, arm, replace(OPTIONS, details=False))
    assert diagnosis.verdict == "clean"
    assert outcome_of(diagnosis).codes == codes

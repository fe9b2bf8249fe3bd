"""The search over cycles a turn: which joint, how many, and nothing in clean ones."""

import numpy as np
import pytest

from benchmarks.blind.hidden.effects import HiddenEffect
from tests.lab.diagnosis.engine_campaigns import DECISION, measured_with, poses
from tests.lab.diagnosis.fitted_rows import measured_rows
from traverse.lab.diagnosis.candidates.scoring import judge, project
from traverse.lab.diagnosis.candidates.waves import (
    MOST_CYCLES,
    periodograms,
    wave_bank,
)
from traverse.lab.diagnosis.diagnose import diagnose

pytestmark = pytest.mark.slow

KIND = "transmission_error"


def test_sums_over_poses_are_those_of_the_columns():
    rows = measured_rows()
    of_joint = next(waves for waves in periodograms(rows) if waves.joint == "J3")
    banks = [wave_bank(rows, "J3", cycles) for cycles in of_joint.cycles[::97].tolist()]
    scores = [judge(rows, project(rows, bank)) for bank in banks]
    statistics = [float(score.statistics[0]) for score in scores]
    evidences = [float(score.evidences[0]) for score in scores]
    np.testing.assert_allclose(of_joint.statistics[::97], statistics, rtol=1e-6)
    np.testing.assert_allclose(
        of_joint.evidences[::97], evidences, rtol=1e-6, atol=1e-6
    )


def teeth(joint: str, cycles: float, size_rad: float = 1.2e-4) -> HiddenEffect:
    sizes = {"cos_rad": 0.6 * size_rad, "sin_rad": -0.8 * size_rad}
    return HiddenEffect(KIND, joint, {"cycles": cycles}, sizes)


@pytest.mark.parametrize(("joint", "cycles"), [("J1", 101.0), ("J5", 318.6)])
def test_joint_and_cycles_of_a_drive_are_found(joint, cycles):
    diagnosis = diagnose(measured_with(teeth(joint, cycles)), poses().arm, DECISION)
    [term] = diagnosis.terms
    assert (term.status, term.candidate.kind) == ("named", KIND)
    assert term.candidate.joint == joint
    # Half a period more or less over the travel would be another wave.
    travel_rad = np.ptp(diagnosis.campaign.poses.angles_rad, axis=0)
    at = diagnosis.campaign.joint_names.index(joint)
    assert abs(term.candidate.cycles - cycles) * travel_rad[at] < 0.1 * np.pi
    size_rad = np.hypot(term.effect.cos_rad, term.effect.sin_rad)
    assert size_rad == pytest.approx(1.2e-4, rel=0.1)
    assert term.effect.cycles == term.candidate.cycles <= MOST_CYCLES


def test_two_drives_of_one_joint_are_both_found():
    wrong = teeth("J2", 80.5), teeth("J2", 202.0, 8e-5)
    diagnosis = diagnose(measured_with(*wrong), poses().arm, DECISION)
    assert [term.candidate.kind for term in diagnosis.terms] == [KIND, KIND]
    cycles = sorted(term.candidate.cycles for term in diagnosis.terms)
    np.testing.assert_allclose(cycles, [80.5, 202.0], atol=0.1)


def test_a_whole_order_of_the_bank_of_harmonics_is_the_encoders():
    sizes = {"cos_rad": 9e-5, "sin_rad": 9e-5}
    wrong = HiddenEffect("encoder_harmonic", "J3", {"order": 36}, sizes)
    diagnosis = diagnose(measured_with(wrong), poses().arm, DECISION)
    [term] = diagnosis.terms
    assert (term.status, term.candidate.name) == (
        "named",
        "encoder_harmonic 36 J3",
    )

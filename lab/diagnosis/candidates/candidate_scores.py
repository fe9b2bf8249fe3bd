"""A stage of a diagnosis: a fit, and every candidate judged on what it leaves over."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.diagnosis.candidates.curves import generic_bank
from traverse.lab.diagnosis.candidates.library import HIGHEST_ORDER, library_bank
from traverse.lab.diagnosis.candidates.scoring import (
    BankScores,
    judge,
    project,
)
from traverse.lab.diagnosis.candidates.steps import StepScan, scan_steps, step_bank
from traverse.lab.diagnosis.candidates.waves import (
    Periodogram,
    harmonic_bank,
    periodograms,
    transmission_bank,
)
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName


@dataclass(frozen=True, slots=True, eq=False)
class CandidateScores:
    """A fit with everything judged on it.

    Attributes:
        banks: Candidates with their columns.
        findings: All of them, judged; steps at their best moments.
        scans: Of steps, at every moment.
        waves: Of every joint, at any number of cycles a turn.
    """

    rows: ObservationEquations
    banks: Mapping[BankName, Bank]
    findings: Mapping[BankName, BankScores]
    scans: tuple[StepScan, ...]
    waves: tuple[Periodogram, ...]


def score_candidates(rows: ObservationEquations, arm: Arm) -> CandidateScores:
    """Build all banks at a fit and judge them."""
    return score_banks(
        rows,
        {
            BankName.LIBRARY: library_bank(rows, arm),
            BankName.GENERIC: generic_bank(rows),
            BankName.HARMONIC: harmonic_bank(rows, HIGHEST_ORDER + 1),
        },
    )


def score_banks(
    rows: ObservationEquations, banks: Mapping[BankName, Bank]
) -> CandidateScores:
    """Judge banks on the residuals of rows."""
    findings = {name: judge(rows, project(rows, bank)) for name, bank in banks.items()}
    scans: tuple[StepScan, ...] = ()
    if BankName.LIBRARY in banks:
        scans = scan_steps(rows)
        steps = judge(rows, project(rows, step_bank(rows, scans)))
        # Judged at their best moments; evidence is the mean over all moments.
        evidences = np.array([scan.evidence for scan in scans])
        findings[BankName.STEPS] = replace(steps, evidences=evidences)
    waves: tuple[Periodogram, ...] = ()
    if BankName.HARMONIC in banks:
        waves = periodograms(rows)
        best = judge(rows, project(rows, transmission_bank(rows, waves)))
        # Judged at their best cycles; evidence is the mean over all cycles.
        evidences = np.array([wave.evidence for wave in waves if wave.best is not None])
        findings[BankName.TRANSMISSION] = replace(best, evidences=evidences)
    return CandidateScores(
        rows, MappingProxyType(dict(banks)), MappingProxyType(findings), scans, waves
    )

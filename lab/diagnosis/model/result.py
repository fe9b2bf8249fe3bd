"""Options and result of a diagnosis."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment import Adjustment, IteratedAdjustment
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.outcomes.diagnosis import (
    BankRemainder,
    Detectable,
    HoldoutResult,
    LedgerLine,
    Term,
    Verdict,
)

# A gap below that many standard deviations of S is none to speak of.
_LEAST_GAP = 3.0


def closed(before: float, after: float, n: int) -> float | None:
    """Return which part of the gap is closed, S before and after as means of n.

    1: all of it; below 0: it grew; None: the gap is within the scatter of S.
    """
    if n == 0 or before - 1.0 < _LEAST_GAP * np.sqrt(2.0 / n):
        return None
    return (before - after) / (before - 1.0)


@dataclass(frozen=True, slots=True)
class HoldoutComparison:
    """Two models compared on held-out poses.

    Attributes:
        is_worse: Whether the poses are predicted worse than before.
    """

    before: HoldoutResult
    after: HoldoutResult
    is_worse: bool

    @property
    def closed(self) -> float | None:
        """Part of the gap that was closed, or None: too little to say."""
        return closed(self.before.chi2, self.after.chi2, self.after.n)


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """The noise as it was found.

    Attributes:
        encoder_rad: Of every joint, (n_joints,).
        contact_mm: Of every artefact, (n_artefacts,).
        orientation_rad: Of measured orientations; None without any.
        serial_share: Part of the variance that is correlated from pose to pose.
        serial_phi: Its correlation from one pose to the next.
    """

    encoder_rad: tuple[float, ...]
    contact_mm: tuple[float, ...]
    orientation_rad: float | None
    serial_share: float
    serial_phi: float


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """The whole result.

    Attributes:
        verdict: The weakest status among the terms, or clean.
        n_library: How many effects the library has for this arm.
        n_visible: How many of them the poses could have shown in some size.
        terms: What was found, in the order of finding.
        arm: As given.
        design: Its geometry, with the signs that fit.
        wrong_signs: Joints that turn the other way than it says.
        zero_offsets_rad: Of zeros that fit much better than its own, by joint.
        adapted: With the accepted terms, everything estimated together.
        before: Fit of the geometry to the choosing poses, without terms.
        after: Fit with the terms of the arm that is written.
        all_terms: Fit with all terms, accepted or not.
        choosing: Poses that were used for choosing, (n_poses,).
        held_out: Poses kept aside, (n_poses,).
        excluded: Poses that contradict all others and did not choose, (n_poses,).
        left_out: Poses that the estimates of the written arm leave out, (n_poses,).
        final: Fit to all poses, whose estimates are written.
        other_scale: By which part of itself the arm is larger or smaller if rivals of
            what was found are true.
        exceeded: How many times the stated noise the poses kept aside are from the
            model with all terms, as a mean square; None: not so many that it counts.
        is_identified_anew: The arm without terms, as identified, predicts poses kept
            aside better than with them, and is what is written.
        blunders: Poses kept aside that contradict their neighbours, (n_poses,).
        gap: On all poses kept aside, by the arm that is written.
        ledger: The same figures after every term, accepted or not.
        vetoed: Whether held-out poses got worse, so that nothing was accepted.
        leftovers: What remains in each bank.
        detectable: Minimal detectable sizes, and undetectable effects.
    """

    verdict: Verdict
    n_library: int
    n_visible: int
    terms: tuple[Term, ...]
    arm: Arm
    design: Geometry
    wrong_signs: tuple[str, ...]
    zero_offsets_rad: Mapping[str, float]
    adapted: Arm
    campaign: Campaign
    before: Adjustment
    after: Adjustment
    all_terms: Adjustment
    choosing: Booleans
    held_out: Booleans
    excluded: Booleans
    left_out: Booleans
    final: IteratedAdjustment
    other_scale: float
    exceeded: float | None
    is_identified_anew: bool
    blunders: Booleans
    gap: HoldoutComparison
    ledger: tuple[LedgerLine, ...]
    vetoed: bool
    noise: NoiseEstimate
    leftovers: tuple[BankRemainder, ...]
    detectable: tuple[Detectable, ...]
    seed: int
    holdout_by: str

    @property
    def left_out_only(self) -> Booleans:
        """Poses that the last estimates leave out, though others chose, (n_poses,)."""
        return self.left_out & ~self.excluded

    @property
    def turned(self) -> Booleans:
        """Poses whose orientation contradicts and took no part, (n_poses,)."""
        used = self.all_terms.network.campaign.poses
        return self.campaign.poses.oriented & ~used.oriented

    @property
    def blind(self) -> bool:
        """Whether the poses could have shown nothing: too few, or too much alike."""
        return self.n_visible == 0

    @property
    def writes_all_terms(self) -> bool:
        """Whether the arm that is written has all terms that were found."""
        return self.after is self.all_terms

    @property
    def adds_terms(self) -> bool:
        """Whether the arm that is written has terms that were found."""
        return self.after is not self.before


@dataclass(frozen=True, slots=True)
class DiagnosisOptions:
    """Wishes.

    Attributes:
        seed: Of the split into choosing and held-out poses, and of the thresholds.
        holdout_by: Name of the split, as in `holdout.SPLITS`.
        level: Probability that anything is found where nothing is missing.
        details: Whether to compute detectable sizes, the final estimates
            from all poses, and the ledger's steps between the first and the last; a
            decision alone needs none of it.
        accept_tentative: Whether tentative terms enter the adapted arm.
    """

    seed: int = 1
    holdout_by: str = "time"
    most_terms: int = 4
    level: float = 0.01
    n_draws: int = 1000
    details: bool = True
    accept_tentative: bool = False

"""The search: add what explains most until nothing is left, then look back."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from traverse.kinematics.arm_file.arm import Effect
from traverse.lab.diagnosis.candidates.candidate_scores import Stage, stage_of
from traverse.lab.diagnosis.candidates.effect_factory import effect_from_candidate
from traverse.lab.diagnosis.model.candidate import BankName
from traverse.lab.diagnosis.model.fit import Fit, fitted, with_effects
from traverse.lab.diagnosis.model.observation_equations import Rows, rows_of
from traverse.lab.diagnosis.model.options import DiagnosisOptions
from traverse.lab.diagnosis.model.serial_correlation import (
    SerialNoise,
    without_serial_noise,
)
from traverse.lab.diagnosis.model.terms import Added
from traverse.lab.diagnosis.search.outlier_recovery import readmitted
from traverse.lab.diagnosis.search.selection import Choice, is_significant, next_choice
from traverse.lab.diagnosis.search.thresholds import log_p_threshold, noise_draws

Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Progress = Callable[[str, float], None]

# How the probability of a false alarm is shared out.
_SHARES = {
    BankName.LIBRARY: 0.7,
    BankName.STEPS: 0.1,
    BankName.GENERIC: 0.1,
    BankName.HARMONIC: 0.1,
}


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """Where a search ended.

    Attributes:
        fit: With all terms.
        stage: Judged there.
        terms: That were added.
        thresholds: log p of each bank.
        first: The stage without terms.
        n_given: Effects that the arm had before.
        serial: The noise that was assumed.
        stuck: A curve that explains what is left, but has no form in an arm file.
    """

    fit: Fit
    stage: Stage
    terms: tuple[Added, ...]
    thresholds: dict[BankName, float]
    first: Stage
    n_given: int
    serial: SerialNoise | None
    stuck: Choice | None = None

    @property
    def settled(self) -> frozenset[str]:
        """Joints whose own angle has an empirical curve."""
        return settled_joints(self.terms)

    @property
    def is_finished(self) -> bool:
        """Whether no bank sees anything more."""
        return not is_significant(self.stage, self.thresholds, self.settled)


def searched(
    start: Fit,
    eligible: Booleans,
    options: DiagnosisOptions,
    serial: SerialNoise | None = None,
    progress: Progress | None = None,
) -> Search:
    """Add terms to a fit until nothing is left to explain.

    Args:
        start: Without further terms.
        eligible: Poses that may take part, (n_poses,).
        options: Wishes.
        serial: Correlation of the noise from pose to pose.
        progress: Told what is done, and which part of the work that is.
    """
    stage = stage_at(start, serial)
    first = stage
    thresholds = family_thresholds(stage, options)
    fit, terms = start, list[Added]()
    n_given = len(start.arm.effects)
    stuck: Choice | None = None
    while len(terms) < options.most_terms:
        settled = settled_joints(terms)
        choice = _choice(stage, thresholds, settled)
        if choice is None or choice.bank is BankName.GENERIC:
            # Poses that look like blunders may be what a curve is about.
            believed = thresholds[BankName.GENERIC]
            again = _with_readmitted(fit, eligible, believed, settled, serial)
            if again is not None:
                better = _choice(again[1], thresholds, settled)
                if better is not None and better.log_p < believed:
                    (fit, stage), choice = again, better
        if choice is None:
            break
        if not is_adaptable(choice):
            stuck = choice
            break
        effect = effect_of(choice, stage.rows)
        if progress is not None:
            progress(f"adding {choice.candidate.name}", 0.3 + 0.1 * len(terms))
        fit = refitted(fit, (*fit.arm.effects, effect), eligible)
        terms.append(Added(choice.candidate, choice.bank, n_given + len(terms)))
        stage = stage_at(fit, serial)
    return Search(fit, stage, tuple(terms), thresholds, first, n_given, serial, stuck)


def _choice(
    stage: Stage, thresholds: dict[BankName, float], settled: frozenset[str]
) -> Choice | None:
    """Choose what to add; None: no bank sees anything."""
    if not is_significant(stage, thresholds, settled):
        return None
    return next_choice(stage, settled)


def _with_readmitted(
    fit: Fit,
    eligible: Booleans,
    log_p: float,
    settled: frozenset[str],
    serial: SerialNoise | None,
) -> tuple[Fit, Stage] | None:
    """Fit again with poses that a curve explains, and judge everything there."""
    included = readmitted(fit, eligible, log_p, settled)
    if included is None:
        return None
    begun = replace(fit, included=included)
    again = refitted(begun, fit.arm.effects, included, snooping=False)
    return again, stage_at(again, serial)


def stage_at(fit: Fit, serial: SerialNoise | None) -> Stage:
    """Judge all candidates on a fit."""
    rows = rows_of(fit.adjustment)
    if serial is not None:
        rows = without_serial_noise(rows, serial)
    return stage_of(rows, fit.arm)


def refitted(
    fit: Fit, effects: tuple[Effect, ...], eligible: Booleans, *, snooping: bool = True
) -> Fit:
    """Fit again with other effects, from where a fit is."""
    campaign = fit.adjustment.network.campaign
    arm = with_effects(fit.arm, effects)
    return fitted(campaign, arm, eligible, fit, snooping=snooping)


def family_thresholds(stage: Stage, options: DiagnosisOptions) -> dict[BankName, float]:
    """Find below which log p each bank sees something."""
    draws = noise_draws(stage.rows, options.n_draws, options.seed)
    found: dict[BankName, float] = {
        name: log_p_threshold(
            stage.rows, findings.projected, draws, _SHARES[name] * options.level
        )
        for name, findings in stage.findings.items()
        if name is not BankName.STEPS
    }
    scans = tuple(scan.largest for scan in stage.scans)
    level = _SHARES[BankName.STEPS] * options.level
    found[BankName.STEPS] = log_p_threshold(stage.rows, (), draws, level, scans)
    return found


def effect_of(choice: Choice, rows: Rows) -> Effect:
    """Write a choice as an effect of the size that the rows say."""
    amplitudes, _ = choice.found.amplitudes(choice.residuals)
    return effect_from_candidate(choice.candidate, amplitudes, rows)


def is_adaptable(choice: Choice) -> bool:
    """Say whether the arm file has a form for it."""
    candidate = choice.candidate
    return candidate.kind != "empirical" or candidate.component == "angle"


def settled_joints(terms: tuple[Added, ...] | list[Added]) -> frozenset[str]:
    """List the joints that have an empirical curve over their own angle."""
    return frozenset(
        str(term.candidate.joint)
        for term in terms
        if term.candidate.covariate == f"{term.candidate.joint}_rad"
    )

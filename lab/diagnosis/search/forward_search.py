"""The search: add what explains most until nothing is left, then look back."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Effect
from traverse.lab.diagnosis.candidates.candidate_scores import (
    CandidateScores,
    score_candidates,
)
from traverse.lab.diagnosis.candidates.effect_factory import effect_of_candidate
from traverse.lab.diagnosis.candidates.periodogram import log_p_of_search
from traverse.lab.diagnosis.model.candidate import BankName
from traverse.lab.diagnosis.model.fit import Fit, fitted, with_effects
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.model.serial_correlation import (
    SerialCorrelation,
    without_serial_noise,
)
from traverse.lab.diagnosis.model.terms import AddedTerm
from traverse.lab.diagnosis.search.outlier_recovery import recover_outliers
from traverse.lab.diagnosis.search.selection import (
    ScoredCandidate,
    is_significant,
    log_p_threshold,
    noise_draws,
    select_next,
)

Progress = Callable[[str, float], None]


def no_progress(_what: str, _part: float) -> None:
    """Take no notice of progress."""


# How the probability of a false alarm is shared out.
_SHARES = {
    BankName.LIBRARY: 0.7,
    BankName.STEPS: 0.1,
    BankName.GENERIC: 0.1,
    BankName.HARMONIC: 0.05,
    BankName.TRANSMISSION: 0.05,
}


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """Where a search ended.

    Attributes:
        thresholds: log p of each bank.
        n_given: Effects that the arm had before.
        serial: The noise that was assumed.
        stuck: A curve that explains what is left, but has no form in an arm file.
    """

    fit: Fit
    stage: CandidateScores
    terms: tuple[AddedTerm, ...]
    thresholds: dict[BankName, float]
    first: CandidateScores
    n_given: int
    serial: SerialCorrelation | None
    stuck: ScoredCandidate | None = None

    @property
    def joints_with_own_curve(self) -> frozenset[str]:
        """Joints whose own angle has an empirical curve."""
        return joints_with_curve(self.terms)

    @property
    def is_finished(self) -> bool:
        """Whether no bank finds anything more."""
        return not is_significant(
            self.stage, self.thresholds, self.joints_with_own_curve
        )


def forward_search(
    start: Fit,
    eligible: Booleans,
    options: DiagnosisOptions,
    serial: SerialCorrelation | None = None,
    progress: Progress = no_progress,
) -> SearchState:
    """Add terms to a fit to eligible poses until nothing is left to explain."""
    stage = scores_at(start, serial)
    first = stage
    thresholds = family_thresholds(stage, options)
    fit, terms = start, list[AddedTerm]()
    n_given = len(start.arm.effects)
    stuck: ScoredCandidate | None = None
    while len(terms) < options.most_terms:
        joints_with_own_curve = joints_with_curve(terms)
        choice = _choice(stage, thresholds, joints_with_own_curve)
        if choice is None or choice.bank is BankName.GENERIC:
            # Poses that look like blunders may be what a curve is about.
            believed = thresholds[BankName.GENERIC]
            again = _with_readmitted(
                fit, eligible, believed, joints_with_own_curve, serial
            )
            if again is not None:
                better = _choice(again[1], thresholds, joints_with_own_curve)
                if better is not None and better.log_p < believed:
                    (fit, stage), choice = again, better
        if choice is None:
            break
        candidate = choice.candidate
        if candidate.is_curve and candidate.component != "angle":
            stuck = choice  # the arm file has no form for it
            break
        effect = effect_of(choice, stage.rows)
        progress(f"adding {choice.candidate.name}", 0.3 + 0.1 * len(terms))
        fit = refitted(fit, (*fit.arm.effects, effect), eligible)
        terms.append(AddedTerm(choice.candidate, choice.bank, n_given + len(terms)))
        stage = scores_at(fit, serial)
    return SearchState(
        fit, stage, tuple(terms), thresholds, first, n_given, serial, stuck
    )


def _choice(
    stage: CandidateScores,
    thresholds: dict[BankName, float],
    joints_with_own_curve: frozenset[str],
) -> ScoredCandidate | None:
    """Choose what to add; None: no bank finds anything."""
    if not is_significant(stage, thresholds, joints_with_own_curve):
        return None
    return select_next(stage, joints_with_own_curve)


def _with_readmitted(
    fit: Fit,
    eligible: Booleans,
    log_p: float,
    joints_with_own_curve: frozenset[str],
    serial: SerialCorrelation | None,
) -> tuple[Fit, CandidateScores] | None:
    """Fit again with poses that a curve explains, and judge everything there."""
    included = recover_outliers(fit, eligible, log_p, joints_with_own_curve)
    if included is None:
        return None
    begun = replace(fit, included=included)
    again = refitted(begun, fit.arm.effects, included, snooping=False)
    return again, scores_at(again, serial)


def scores_at(fit: Fit, serial: SerialCorrelation | None) -> CandidateScores:
    """Judge all candidates on a fit."""
    rows = equations_of(fit.adjustment)
    if serial is not None:
        rows = without_serial_noise(rows, serial)
    return score_candidates(rows, fit.arm)


def refitted(
    fit: Fit, effects: tuple[Effect, ...], eligible: Booleans, *, snooping: bool = True
) -> Fit:
    """Fit again with other effects, from where a fit is."""
    campaign = fit.adjustment.network.campaign
    arm = with_effects(fit.arm, effects)
    return fitted(campaign, arm, eligible, fit, snooping=snooping)


def family_thresholds(
    stage: CandidateScores, options: DiagnosisOptions
) -> dict[BankName, float]:
    """Find each bank's threshold of log p."""
    draws = noise_draws(stage.rows, options.n_draws, options.seed)
    found: dict[BankName, float] = {
        name: log_p_threshold(
            stage.rows, findings.projected, draws, _SHARES[name] * options.level
        )
        for name, findings in stage.findings.items()
        if name not in (BankName.STEPS, BankName.TRANSMISSION)
    }
    scans = tuple(scan.largest for scan in stage.scans)
    level = _SHARES[BankName.STEPS] * options.level
    found[BankName.STEPS] = log_p_threshold(stage.rows, (), draws, level, scans)
    found[BankName.TRANSMISSION] = log_p_of_search(
        stage.waves, _SHARES[BankName.TRANSMISSION] * options.level
    )
    return found


def effect_of(choice: ScoredCandidate, rows: ObservationEquations) -> Effect:
    """Write a choice as an effect of the size that the rows say."""
    amplitudes, _ = choice.found.amplitudes(choice.residuals)
    return effect_of_candidate(choice.candidate, amplitudes, rows)


def joints_with_curve(terms: tuple[AddedTerm, ...] | list[AddedTerm]) -> frozenset[str]:
    """List the joints that have an empirical curve over their own angle."""
    return frozenset(
        str(term.candidate.joint)
        for term in terms
        if term.candidate.covariate == f"{term.candidate.joint}_rad"
    )

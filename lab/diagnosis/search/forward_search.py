"""The search: add what explains most until nothing is left."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Effect
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.readings.harmonics import (
    EncoderEccentricity,
    EncoderHarmonic,
)
from traverse.lab.diagnosis.candidates.candidate_scores import (
    CandidateScores,
    score_banks,
    score_candidates,
)
from traverse.lab.diagnosis.candidates.scoring import ProjectedCandidate
from traverse.lab.diagnosis.model.candidate import effect_of_candidate, has_own_curve
from traverse.lab.diagnosis.model.fit import AddedTerm, Fit, fitted, with_effects
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.model.serial_noise import (
    SerialCorrelation,
    without_serial_noise,
)
from traverse.lab.diagnosis.search.outlier_recovery import recover_outliers
from traverse.lab.diagnosis.search.thresholds import family_thresholds
from traverse.lab.first_moments import own_effects
from traverse.lab.outcomes.candidate import BankName, Candidate

# Evidence that decides between two explanations: 20 to 1.
DECIDED = float(np.log(20.0))
NAMED_BANKS = (
    BankName.LIBRARY,
    BankName.STEPS,
    BankName.HARMONIC,
    BankName.TRANSMISSION,
)
_N_PAIRED = 3


@dataclass(frozen=True, slots=True, eq=False)
class ScoredCandidate:
    """A candidate with what speaks for it.

    Attributes:
        projected: The candidate, free of what the unknowns absorb.
        evidence: Log Bayes factor.
        score: With the preference for its kind.
        log_p: Of its test.
        residuals: That it was judged on, (n_rows,).
    """

    projected: ProjectedCandidate
    evidence: float
    score: float
    log_p: float
    residuals: Floats

    @property
    def candidate(self) -> Candidate:
        return self.projected.candidate


def ranked(
    stage: CandidateScores,
    names: Collection[BankName],
    joints_with_own_curve: Collection[str],
) -> list[ScoredCandidate]:
    """Sort the candidates of some banks, the best first.

    Functions of readings that have an empirical curve already are left out.
    """
    choices = [
        choice
        for name in names
        for choice in _choices(stage, name, joints_with_own_curve)
    ]
    return sorted(choices, key=lambda choice: -choice.score)


def is_significant(
    stage: CandidateScores,
    thresholds: dict[BankName, float],
    joints_with_own_curve: Collection[str],
) -> bool:
    """Return whether any bank finds anything."""
    return any(
        choice.log_p < threshold
        for name, threshold in thresholds.items()
        for choice in _choices(stage, name, joints_with_own_curve)
    )


def select_next(
    stage: CandidateScores,
    thresholds: dict[BankName, float],
    joints_with_own_curve: Collection[str],
) -> ScoredCandidate | None:
    """Choose what to add: a name if it explains as much as any curve does.

    A curve that wins may be two named effects at once: then the name that with a
    second one explains as much is first. None: no bank finds anything.
    """
    if not is_significant(stage, thresholds, joints_with_own_curve):
        return None
    named = ranked(stage, NAMED_BANKS, joints_with_own_curve)
    curves = ranked(stage, (BankName.GENERIC,), joints_with_own_curve)
    if not curves:
        return named[0] if named else None
    needed = curves[0].score - DECIDED
    if named and named[0].score >= needed:
        return named[0]
    for first in named[:_N_PAIRED]:
        # Strategy: a ring that is both off its centre and tilted errs once and twice a
        # turn, as any ring does a little. Two waves imitate many curves where a joint
        # turns little, so that both need to explain as much as the curve does, over
        # most of a turn.
        pair_needs = {False: needed, True: curves[0].score}
        basis = np.hstack([stage.rows.basis, first.projected.directions])
        beside_first = score_banks(
            replace(stage.rows, basis=basis),
            {BankName.LIBRARY: stage.banks[BankName.LIBRARY]},
        )
        seconds = ranked(beside_first, (BankName.LIBRARY,), joints_with_own_curve)[:1]
        if any(
            first.score + max(second.score, 0.0)
            >= pair_needs[is_mounting(stage.rows, first.candidate, second.candidate)]
            and not fit_any_curve_together(
                stage.rows, first.candidate, second.candidate
            )
            for second in seconds
        ):
            return first
    adaptable = [curve for curve in curves if curve.candidate.component == "angle"]
    if adaptable and adaptable[0].score >= curves[0].score - DECIDED:
        return adaptable[0]
    return curves[0]


def fit_any_curve_together(
    rows: ObservationEquations, first: Candidate, second: Candidate
) -> bool:
    """Say whether two effects go round with one joint: together they fit any curve.

    But for the two of an encoder's ring where most of a turn is seen.
    """
    return (
        first.joint == second.joint
        and EFFECT_KINDS[first.kind].turns_with_joint
        and EFFECT_KINDS[second.kind].turns_with_joint
        and not is_mounting(rows, first, second)
    )


_OF_A_RING = {(EncoderEccentricity.kind, None), (EncoderHarmonic.kind, 2)}
_MOST_OF_A_TURN_RAD = np.radians(270.0)


def is_mounting(
    rows: ObservationEquations, first: Candidate, second: Candidate
) -> bool:
    """Say whether two effects are those of one ring, eccentric and tilted.

    Only where the joint was seen over most of a turn: else they are any curve.
    """
    if first.joint is None or first.joint != second.joint:
        return False
    if {(wave.kind, wave.order) for wave in (first, second)} != _OF_A_RING:
        return False
    joint_index = rows.adjustment.network.campaign.joint_names.index(first.joint)
    travel_rad = float(np.ptp(rows.block.angles_rad[rows.used_poses, joint_index]))
    return bool(travel_rad > _MOST_OF_A_TURN_RAD)


def _choices(
    stage: CandidateScores, name: BankName, joints_with_own_curve: Collection[str]
) -> list[ScoredCandidate]:
    findings, residuals = stage.findings[name], stage.rows.residuals
    return [
        ScoredCandidate(
            projected, float(evidence), float(score), float(log_p), residuals
        )
        for projected, evidence, score, log_p in zip(
            findings.projected,
            findings.evidences,
            findings.scores,
            findings.log_p,
            strict=True,
        )
        if len(projected.singular_values)
        and projected.is_plausible(residuals)
        and not has_own_curve(projected.candidate, joints_with_own_curve)
    ]


def _has_form(candidate: Candidate) -> bool:
    """Return whether an arm file can hold it."""
    return not candidate.is_curve or candidate.component == "angle"


_MOST_STUCK = 3


@dataclass(frozen=True, slots=True, eq=False)
class StuckCurve:
    """A curve that explains what is left, but has no form in an arm file.

    Attributes:
        choices: All candidates beside which it was chosen, the best first.
    """

    choice: ScoredCandidate
    choices: list[ScoredCandidate]


def stuck_curves(
    stage: CandidateScores,
    thresholds: dict[BankName, float],
    joints_with_own_curve: Collection[str],
) -> tuple[StuckCurve, ...]:
    """Choose a curve without a form; of artefacts several, as each may move."""
    curves: list[StuckCurve] = []
    while len(curves) < _MOST_STUCK:
        choice = select_next(stage, thresholds, joints_with_own_curve)
        if choice is None or _has_form(choice.candidate):
            break
        if curves and choice.candidate.artefact is None:
            break
        choices = ranked(stage, tuple(BankName), joints_with_own_curve)
        curves.append(StuckCurve(choice, choices))
        if choice.candidate.artefact is None:
            break
        basis = np.hstack([stage.rows.basis, choice.projected.directions])
        stage = score_banks(replace(stage.rows, basis=basis), stage.banks)
    return tuple(curves)


Progress = Callable[[str, float], None]


def no_progress(_what: str, _part: float) -> None:
    """Take no notice of progress."""


@dataclass(frozen=True, slots=True, eq=False)
class SearchState:
    """Where a search ended.

    Attributes:
        thresholds: log p of each bank.
        n_given: Effects that the arm had before.
        serial: The noise that was assumed.
        stuck: Curves that explain what is left, but have no form in an arm file.
    """

    fit: Fit
    stage: CandidateScores
    terms: tuple[AddedTerm, ...]
    thresholds: dict[BankName, float]
    first: CandidateScores
    n_given: int
    serial: SerialCorrelation | None
    stuck: tuple[StuckCurve, ...] = ()

    @property
    def joints_with_own_curve(self) -> frozenset[str]:
        """Joints whose own angle has an empirical curve."""
        return joints_with_curve(self.terms)

    @property
    def unexplained(self) -> ObservationEquations:
        """The rows of the fit, free also of what the stuck curves explain."""
        rows = self.stage.rows
        explained = [curve.choice.projected.directions for curve in self.stuck]
        return replace(rows, basis=np.hstack([rows.basis, *explained]))

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
    n_given = len(own_effects(start.arm))
    stuck: tuple[StuckCurve, ...] = ()
    while len(terms) < options.most_terms:
        joints_with_own_curve = joints_with_curve(terms)
        choice = select_next(stage, thresholds, joints_with_own_curve)
        if choice is None or choice.candidate.bank is BankName.GENERIC:
            # Poses that look like blunders may be what a curve is about.
            threshold = thresholds[BankName.GENERIC]
            again = _with_readmitted(
                fit, eligible, threshold, joints_with_own_curve, serial
            )
            if again is not None:
                better = select_next(again[1], thresholds, joints_with_own_curve)
                if better is not None and better.log_p < threshold:
                    (fit, stage), choice = again, better
        if choice is None:
            break
        candidate = choice.candidate
        if not _has_form(candidate):
            stuck = stuck_curves(stage, thresholds, joints_with_own_curve)
            break
        effect = effect_of(choice, stage.rows)
        progress(f"adding {candidate.name}", 0.3 + 0.1 * len(terms))
        fit = refitted(fit, (*fit.arm.effects, effect), eligible)
        terms.append(AddedTerm(candidate, n_given + len(terms)))
        stage = scores_at(fit, serial)
    return SearchState(
        fit, stage, tuple(terms), thresholds, first, n_given, serial, stuck
    )


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


def effect_of(choice: ScoredCandidate, rows: ObservationEquations) -> Effect:
    """Write a choice as an effect of the size that the rows say."""
    amplitudes, _ = choice.projected.amplitudes(choice.residuals)
    return effect_of_candidate(choice.candidate, amplitudes, rows)


def joints_with_curve(terms: tuple[AddedTerm, ...] | list[AddedTerm]) -> frozenset[str]:
    return frozenset(
        str(term.candidate.joint)
        for term in terms
        if term.candidate.covariate == f"{term.candidate.joint}_rad"
    )

"""The decision: what is missing, from the choosing poses alone, and its names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import LEAST_REDUNDANCY
from traverse.lab.diagnosis.model.fit import (
    AddedTerm,
    Fit,
    fitted,
)
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.model.serial_noise import (
    SerialCorrelation,
    is_serially_correlated,
    likeliest_serial_noise,
    serial_correlation,
)
from traverse.lab.diagnosis.search.forward_search import (
    Progress,
    ScoredCandidate,
    SearchState,
    effect_of,
    forward_search,
    joints_with_curve,
    no_progress,
    refitted,
    scores_at,
    stuck_curves,
)
from traverse.lab.diagnosis.search.naming import NamedTerm, name_terms
from traverse.lab.diagnosis.search.thresholds import noise_draws
from traverse.lab.outcomes.candidate import Candidate

# Another name must be better by this much to take a term's place.
_BETTER = 1.0
_SERIAL_LEVEL = 0.01
_LEAST_TRAVEL_RAD = np.radians(2.0)
_MOST_REVISIONS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """Outcome of a decision.

    Attributes:
        start: Fit without terms to the eligible poses, as an identification.
    """

    search: SearchState
    names: tuple[NamedTerm, ...]
    start: Fit


def decide(
    campaign: Campaign,
    arm: Arm,
    eligible: Booleans,
    options: DiagnosisOptions,
    progress: Progress = no_progress,
) -> Decision:
    """Search with white noise, and again with serial noise if that is what is left.

    Only eligible poses, (n_poses,), are used for choosing; those that only their
    orientation excludes take part again without it.

    Raises:
        IdentificationError: The poses are too few, or too much alike.
    """
    progress("fitting the geometry", 0.05)
    start = fitted(campaign, arm, eligible)
    _check(campaign, start, eligible)
    progress("judging every candidate", 0.15)
    search, names = _revised(
        forward_search(start, eligible, options, None, progress), eligible
    )
    serial = _serial_noise(campaign, search, names, options)
    if serial is not None:
        search, names = _revised(
            forward_search(start, eligible, options, serial, progress), eligible
        )
    turned = eligible & search.fit.contradicted_by_orientation()
    if np.any(turned):
        remaining = campaign.without_orientations(turned)
        return decide(remaining, arm, eligible, options, progress)
    return Decision(search, names, start)


def _serial_noise(
    campaign: Campaign,
    search: SearchState,
    names: Sequence[NamedTerm],
    options: DiagnosisOptions,
) -> SerialCorrelation | None:
    """Find serial noise beside what a search with white noise found; None: it is white.

    Strategy: where the search found a drift, or a curve over time, that took the place
    of slow noise, nothing serial is left beside it. So residuals without it are tested
    as well, and there the likelier one wins: slow noise has two parameters for all of
    its waves, a drift goes one way, a curve has as many as it has knots.
    """

    def is_serial(rows: ObservationEquations) -> bool:
        draws = noise_draws(rows, options.n_draws, options.seed)
        return is_serially_correlated(rows, draws, _SERIAL_LEVEL)

    if is_serial(search.unexplained):
        return serial_correlation(_rows_of_noise(campaign, search))
    slow = [
        naming.choice.evidence
        for naming in names
        if _follows_time(naming.added.candidate)
    ]
    slow += [
        curve.choice.evidence
        for curve in search.stuck
        if _follows_time(curve.choice.candidate)
    ]
    if not slow:
        return None
    rows = _rows_of_noise(campaign, search)
    if not is_serial(rows):
        return None
    serial, evidence = likeliest_serial_noise(rows)
    return serial if evidence > sum(slow) else None


# Standard deviations of a mean square of white noise: more is more than was stated.
_BEYOND_STATED = 4.0


def _rows_of_noise(campaign: Campaign, search: SearchState) -> ObservationEquations:
    """Choose the rows whose residuals are noise, with or without what was found.

    Strategy: a drift and noise that is correlated from pose to pose look alike, and a
    search that takes noise for white finds drifts in it. So the noise is by default
    what is left before any term took its part. But stated noise says how much there can
    be of it: where residuals exceed that, the excess is something else, and to count it
    as noise would hide it. If terms that do not follow the time explain the excess, a
    backlash say, then noise is what is left beside these; else the excess is a drift, a
    temperature or a force, and noise is what is left beside all terms.
    """
    first = search.first.rows
    if not campaign.states_noise:
        return first
    if not exceeds_stated(first):
        return first
    slow = {term.index for term in search.terms if _follows_time(term.candidate)}
    effects = search.fit.arm.effects
    kept = tuple(effect for index, effect in enumerate(effects) if index not in slow)
    fit = refitted(search.fit, kept, search.fit.included, snooping=False)
    beside = equations_of(fit.adjustment)
    return search.unexplained if exceeds_stated(beside) else beside


def exceeds_stated(rows: ObservationEquations) -> bool:
    """Return whether residuals are beyond the noise that a campaign states."""
    redundancy = max(rows.redundancy, 1)
    limit = 1.0 + _BEYOND_STATED * np.sqrt(2.0 / redundancy)
    return bool(rows.sum_of_squares / redundancy >= limit)


def _follows_time(candidate: Candidate) -> bool:
    family = EFFECT_KINDS[candidate.kind].family
    return family is Family.SLOW or candidate.covariate == "time_s"


# Of the links together: what no missing effect leaves.
_HOPELESS = 0.05


def _check(campaign: Campaign, start: Fit, eligible: Booleans) -> None:
    """Refuse what no test could judge."""
    links_mm = start.adjustment.state.arm.geometry.links_mm
    reach_mm = float(np.sum(np.linalg.norm(links_mm, axis=1)))
    misclosures_mm = start.statistics.misclosures_mm[eligible]
    left_mm = float(np.median(np.sqrt(np.nansum(misclosures_mm**2, axis=1))))
    if left_mm > _HOPELESS * reach_mm:
        raise IdentificationError(
            f"arm file and campaign do not belong together: misclosures of "
            f"{left_mm:.0f} mm (median) are left, of an arm of {reach_mm:.0f} mm; "
            "check units, order, signs and zeros of the joints, with traverse identify"
        )
    n_poses = int(np.count_nonzero(start.included))
    travel_rad = np.ptp(campaign.poses.angles_rad, axis=0)
    if np.max(travel_rad) < _LEAST_TRAVEL_RAD:
        raise IdentificationError(
            f"the {len(campaign.poses)} poses are nearly the same: no joint turned by "
            f"more than {np.degrees(np.max(travel_rad)):.2g} degrees; nothing can be "
            "found in them; measure in varied postures"
        )
    redundancy = start.adjustment.redundancy
    if redundancy < LEAST_REDUNDANCY:
        raise IdentificationError(
            f"{n_poses} poses leave {redundancy} equations beyond the unknowns "
            "(redundancy), and effects cannot be told from noise with fewer than "
            f"{LEAST_REDUNDANCY}; measure more poses"
        )


def _revised(
    search: SearchState, eligible: Booleans
) -> tuple[SearchState, tuple[NamedTerm, ...]]:
    """Revise: names that became better replace others, terms without need leave."""
    names = name_terms(search)
    for _ in range(_MOST_REVISIONS):
        revision = _revision(search, names)
        if revision is None:
            break
        naming, better = revision
        search = _changed(search, naming.added, better, eligible)
        names = name_terms(search)
    return search, names


def _revision(
    search: SearchState, names: tuple[NamedTerm, ...]
) -> tuple[NamedTerm, ScoredCandidate | None] | None:
    """Find the term that should go or change its name, with the better name."""
    for naming in names:
        if naming.choice.log_p > search.thresholds[naming.added.candidate.bank]:
            return naming, None
    for naming in names:
        # A step keeps its name when its moment moves.
        if naming.choice.candidate.at_s != naming.added.candidate.at_s:
            return naming, naming.choice
        is_other = naming.best.candidate.identity != naming.added.candidate.identity
        if is_other and naming.best.score > naming.choice.score + _BETTER:
            return naming, naming.best
    return None


def _changed(
    search: SearchState,
    added: AddedTerm,
    better: ScoredCandidate | None,
    eligible: Booleans,
) -> SearchState:
    """Take a term out of a search, or put another into its place."""
    effects = list(search.fit.arm.effects)
    terms = list(search.terms)
    position = terms.index(added)
    if better is None:
        del effects[added.index], terms[position]
        terms = [
            replace(term, index=term.index - (term.index > added.index))
            for term in terms
        ]
    else:
        effects[added.index] = effect_of(better, search.stage.rows)
        terms[position] = AddedTerm(better.candidate, added.index)
    fit = refitted(search.fit, tuple(effects), eligible)
    stage, stuck = scores_at(fit, search.serial), search.stuck
    if stuck:
        # Of the poses that take part now.
        stuck = stuck_curves(stage, search.thresholds, joints_with_curve(terms))
    return replace(search, fit=fit, terms=tuple(terms), stage=stage, stuck=stuck)

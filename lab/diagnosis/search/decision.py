"""The decision: what is missing, from the choosing poses alone."""

from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.fit import Fit, fitted
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.model.serial_correlation import (
    SerialCorrelation,
    is_serially_correlated,
    serial_correlation,
)
from traverse.lab.diagnosis.model.terms import AddedTerm
from traverse.lab.diagnosis.search.forward_search import (
    Progress,
    SearchState,
    effect_of,
    forward_search,
    no_progress,
    refitted,
    scores_at,
)
from traverse.lab.diagnosis.search.naming import NamedTerm, name_terms
from traverse.lab.diagnosis.search.selection import ScoredCandidate, noise_draws
from traverse.lab.identification.identify import IdentificationError

# Another name must be better by this much to take a term's place.
_BETTER = 1.0
_SERIAL_LEVEL = 0.01
# Less says nothing about noise, and so nothing about effects.
_LEAST_REDUNDANCY = 10
_LEAST_TRAVEL_RAD = np.radians(2.0)
_MOST_REVISIONS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """Outcome of a decision."""

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

    Only eligible poses, (n_poses,), are used for choosing.

    Raises:
        IdentificationError: The poses are too few, or too much alike.
    """
    progress("fitting the geometry", 0.05)
    start = fitted(campaign, arm, eligible)
    _check(campaign, start)
    serial: SerialCorrelation | None = None
    progress("judging every candidate", 0.15)
    search, names = _revised(
        forward_search(start, eligible, options, None, progress), eligible
    )
    rows = search.stage.rows
    if is_serially_correlated(
        rows, noise_draws(rows, options.n_draws, options.seed), _SERIAL_LEVEL
    ):
        # Before terms took their part of it: drifts would pass for terms else.
        serial = serial_correlation(search.first.rows)
        search, names = _revised(
            forward_search(start, eligible, options, serial, progress), eligible
        )
    return Decision(search, names, start)


def _check(campaign: Campaign, start: Fit) -> None:
    """Refuse what no test could judge."""
    n_poses = int(np.count_nonzero(start.included))
    travel_rad = np.ptp(campaign.poses.angles_rad, axis=0)
    if np.max(travel_rad) < _LEAST_TRAVEL_RAD:
        raise IdentificationError(
            f"the {len(campaign.poses)} poses are nearly the same: no joint turned by "
            f"more than {np.degrees(np.max(travel_rad)):.2g} degrees; nothing can be "
            "found in them; measure in varied postures"
        )
    redundancy = start.adjustment.redundancy
    if redundancy < _LEAST_REDUNDANCY:
        raise IdentificationError(
            f"{n_poses} poses leave {redundancy} equations beyond the unknowns "
            "(redundancy), and effects cannot be told from noise with fewer than "
            f"{_LEAST_REDUNDANCY}; measure more poses"
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
        if naming.own.log_p > search.thresholds[naming.added.bank]:
            return naming, None
    for naming in names:
        # A step keeps its name when its moment moves.
        if naming.own.candidate.at_s != naming.added.candidate.at_s:
            return naming, naming.own
        is_other = naming.best.candidate.identity != naming.added.candidate.identity
        if is_other and naming.best.score > naming.own.score + _BETTER:
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
    at = terms.index(added)
    if better is None:
        del effects[added.index], terms[at]
        terms = [
            replace(term, index=term.index - (term.index > added.index))
            for term in terms
        ]
    else:
        effects[added.index] = effect_of(better, search.stage.rows)
        terms[at] = AddedTerm(better.candidate, better.bank, added.index)
    fit = refitted(search.fit, tuple(effects), eligible)
    return replace(
        search, fit=fit, terms=tuple(terms), stage=scores_at(fit, search.serial)
    )

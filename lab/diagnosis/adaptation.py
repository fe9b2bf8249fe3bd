"""What enters the arm file: terms that prove themselves, estimated from all poses."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, fields, replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Effect
from traverse.lab.adjustment import IteratedAdjustment
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.holdout.comparison import is_better
from traverse.lab.diagnosis.model.fit import Fit, fitted, has_epoch, with_effects
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import DiagnosisOptions, HoldoutComparison
from traverse.lab.diagnosis.model.serial_noise import without_serial_noise
from traverse.lab.diagnosis.search.decision import Decision
from traverse.lab.diagnosis.search.forward_search import SearchState, refitted
from traverse.lab.diagnosis.search.naming import NamedTerm, of_single_joints

# Compares a fit with the one without terms, on the poses kept aside.
Compared = Callable[[Fit], HoldoutComparison]


@dataclass(frozen=True, slots=True, eq=False)
class Adaptation:
    """The arm that is written, and what it is made of.

    Attributes:
        accepted: Indices of the terms that enter it.
        written: Fit to the choosing poses, with the terms that the file can hold.
        unhelpful: Indices of terms that would have entered, but without which poses
            kept aside are predicted better.
        vetoed: Whether these predict significantly worse with all terms.
        is_identified_anew: Whether terms would have entered, but the arm identified
            without them predicts better, and is written in its place.
        gap: On the poses kept aside, by the arm that is written.
    """

    accepted: frozenset[int]
    written: Fit
    unhelpful: frozenset[int]
    vetoed: bool
    is_identified_anew: bool
    gap: HoldoutComparison


@dataclass(frozen=True, slots=True, eq=False)
class FinalEstimates:
    """Estimates from all poses.

    Attributes:
        adapted: Of the arm that is written.
        with_all_terms: Accepted or not.
        rows: Of the latter.
    """

    adapted: Fit
    with_all_terms: Fit
    rows: ObservationEquations


def adaptation(
    decision: Decision,
    fits: tuple[Fit, ...],
    compared: Compared,
    choosing: Booleans,
    options: DiagnosisOptions,
) -> Adaptation:
    """Choose the terms that enter the arm file.

    The fits are those of the ledger: the first without terms, the last with all.

    Strategy: significance among the poses that chose a term says that something is
    there, not that its name or curve goes on where nothing was measured. Each term has
    to lower the misfit of poses that took no part, beside the others; of those that do
    not the worst leaves first. A term of all joints beside one of its kind at a joint
    has to bring them clearly nearer, as little tells the two apart. At last the arm is
    compared with what an identification would give from the same poses, which leaves
    others out.
    """
    search = decision.search
    campaign = search.fit.adjustment.network.campaign
    effects = search.fit.arm.effects
    candidates = accepted_by_name(decision.names, options)
    # An arm file holds no effect whose epoch is not known.
    writable = {index for index in candidates if has_epoch(effects[index], campaign)}
    vetoed = len(fits) > 1 and compared(fits[-1]).is_worse
    unhelpful: set[int] = set()
    if vetoed:
        writable, unhelpful = set(), writable
    written, gap = _with_terms(search, fits, compared, writable)
    while writable and gap.after.n:
        trials = [
            (index, *_with_terms(search, fits, compared, writable - {index}))
            for index in sorted(writable)
        ]
        worst, fit, without = min(trials, key=lambda trial: _misfit(trial[2]))
        if _misfit(gap) < _misfit(without):
            break
        unhelpful.add(worst)
        writable.remove(worst)
        written, gap = fit, without
    for index in _of_all_joints(decision.names, writable):
        fit, without = _with_terms(search, fits, compared, writable - {index})
        if not is_better(gap.after, without.after):
            unhelpful.add(index)
            writable.remove(index)
            written, gap = fit, without
    reference = as_identified(decision.start, choosing)
    identified = compared(reference)
    is_identified_anew = is_better(identified.after, gap.after)
    if is_identified_anew:
        unhelpful |= writable
        writable, written, gap = set(), reference, identified
    return Adaptation(
        accepted=frozenset(candidates - unhelpful),
        written=written,
        unhelpful=frozenset(unhelpful),
        vetoed=vetoed,
        is_identified_anew=is_identified_anew and bool(candidates),
        gap=gap,
    )


def _of_all_joints(
    names: tuple[NamedTerm, ...], writable: Collection[int]
) -> tuple[int, ...]:
    """List the terms of all joints that stand beside one of their kind at a joint."""
    beside = [naming for naming in names if naming.added.index in writable]
    return tuple(
        naming.added.index for naming in beside if of_single_joints(naming, beside)
    )


def _misfit(comparison: HoldoutComparison) -> float:
    last = comparison.after.without_blunders or comparison.after
    return last.chi2


def _with_terms(
    search: SearchState,
    fits: tuple[Fit, ...],
    compared: Compared,
    indices: Collection[int],
) -> tuple[Fit, HoldoutComparison]:
    """Fit some of the terms to the choosing poses, and judge it."""
    if not indices:
        fit = fits[0]
    elif len(indices) == len(search.terms):
        fit = search.fit
    else:
        kept = kept_effects(search, indices)
        fit = refitted(search.fit, kept, search.fit.included, snooping=False)
    return fit, compared(fit)


def as_identified(fit: Fit, eligible: Booleans) -> Fit:
    """Take poses back that an identification would, since they lie together.

    Of the eligible ones, (n_poses,), to which the fit was made.
    """
    if np.all(fit.included | ~eligible):
        return fit
    campaign = fit.adjustment.network.campaign
    inside = np.flatnonzero(eligible)
    last = fit

    def part_of(fit_of_all: Fit) -> Fit:
        whole_statistics = fit_of_all.statistics
        arrays = {
            field.name: getattr(whole_statistics, field.name)[inside]
            for field in fields(whole_statistics)
            if field.name != "variances"
        }
        return replace(
            fit_of_all,
            included=fit_of_all.included[inside],
            statistics=replace(whole_statistics, **arrays),
        )

    def again(never_excluded: Booleans) -> IteratedAdjustment:
        nonlocal last
        stays = np.zeros_like(eligible)
        stays[inside[never_excluded]] = True
        last = fitted(campaign, last.arm, eligible, last, never_excluded=stays)
        return part_of(last)

    part_of(fit).with_clusters_back(campaign.part(eligible), again)
    return last


def accepted_by_name(
    names: tuple[NamedTerm, ...], options: DiagnosisOptions
) -> set[int]:
    """List the terms that may enter the adapted arm, by what they are."""
    return {
        naming.added.index
        for naming in names
        if naming.harmonic is None
        and not naming.is_oversized
        and not naming.is_negative
        and (naming.status != "tentative" or options.accept_tentative)
    }


def final_estimates(
    campaign: Campaign,
    search: SearchState,
    accepted: Collection[int],
    options: DiagnosisOptions,
) -> FinalEstimates:
    """Estimate everything again from all poses, with the accepted terms."""
    if not options.details:
        return FinalEstimates(search.fit, search.fit, search.stage.rows)
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    again = refitted(search.fit, search.fit.arm.effects, everyone)
    with_all_poses = as_identified(again, everyone)
    rows = equations_of(with_all_poses.adjustment)
    if search.serial is not None:
        rows = without_serial_noise(rows, search.serial)
    adapted = with_all_poses
    if len(accepted) < len(search.terms):
        kept = kept_effects(search, accepted)
        adapted = as_identified(refitted(search.fit, kept, everyone), everyone)
    return FinalEstimates(adapted, with_all_poses, rows)


def other_scale_of(decision: Decision, accepted: Collection[int], final: Fit) -> float:
    """Return by which part the arm is larger or smaller if rivals of terms are true.

    Of rivals that are lengths which the arm takes up as its scale. Without their
    certificates, and without the term, the other lengths say how large the arm is.
    """
    everyone = np.ones_like(final.included)
    parts = [0.0]
    for naming in decision.names:
        for rival in naming.alternatives:
            if not rival.changes_scale:
                continue
            names = str(rival.candidate.artefact).split(", ")
            campaign = _without_distances(final.adjustment.network.campaign, names)
            kept = kept_effects(decision.search, set(accepted) - {naming.added.index})
            other = fitted(campaign, with_effects(final.arm, kept), everyone, final)
            if other.adjustment.network.has_length() and other.adjustment.converged:
                parts.append(abs(other.size - 1.0))
    return max(parts)


def _without_distances(campaign: Campaign, names: Collection[str]) -> Campaign:
    """Leave out what some artefacts certify: distances, or a radius alone."""
    artefacts = {artefact.id: artefact for artefact in campaign.artefacts}
    for name in names:
        certified = set(artefacts[name].certified_lengths)
        distances = certified - set(artefacts[name].certified_radii)
        for length in distances or certified:
            artefacts[name] = artefacts[name].without_certificate(length)
    return replace(campaign, artefacts=tuple(artefacts.values()))


def kept_effects(search: SearchState, accepted: Collection[int]) -> tuple[Effect, ...]:
    """List the effects that the arm had, and the accepted ones."""
    rejected = {term.index for term in search.terms} - set(accepted)
    effects = search.fit.arm.effects
    return tuple(e for index, e in enumerate(effects) if index not in rejected)

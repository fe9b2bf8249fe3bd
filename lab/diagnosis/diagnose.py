"""Diagnosis: find what the model lacks, name it, add it, show that the gap shrank."""

from dataclasses import replace
from itertools import pairwise
from time import perf_counter

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.advice.experiments import separate_by
from traverse.lab.diagnosis.advice.minimal_detectable import detectable
from traverse.lab.diagnosis.candidates.library import absent_candidates
from traverse.lab.diagnosis.holdout.comparison import (
    compare_on_holdout,
    find_misfit,
    held_out_blunders,
)
from traverse.lab.diagnosis.holdout.holdout import SPLITS
from traverse.lab.diagnosis.model.candidate import BankName, Candidate
from traverse.lab.diagnosis.model.covariates import outlier_cluster
from traverse.lab.diagnosis.model.fit import (
    Fit,
    estimates_of,
    fitted,
    has_epoch,
    with_tools_begun,
)
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    SerialCorrelation,
    equations_of,
    without_serial_noise,
)
from traverse.lab.diagnosis.model.result import (
    BankRemainder,
    Detectable,
    Diagnosis,
    DiagnosisOptions,
    HoldoutComparison,
    HoldoutMisfit,
    NoiseEstimate,
    Step,
    Term,
    Verdict,
)
from traverse.lab.diagnosis.search.decision import Decision, NamedTerm, decide
from traverse.lab.diagnosis.search.forward_search import (
    Progress,
    SearchState,
    no_progress,
    ranked,
    refitted,
)
from traverse.lab.identification.identify import IdentificationError
from traverse.lab.identification.solve.contradictions import contradicted_expectation
from traverse.lab.statistics.outlier_clusters import ARTEFACT

__all__ = ["DiagnosisOptions", "diagnose"]


def diagnose(
    campaign: Campaign,
    arm: Arm,
    options: DiagnosisOptions | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose an arm: the design, or an identified one.

    The geometry and all effects that it has already are estimated together with what is
    added. Progress is what is done, and which part of the work that is (0 to 1).

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    options = options or DiagnosisOptions()
    told = progress or no_progress
    laps = [("start", perf_counter())]

    def lap(done: str) -> None:
        laps.append((done, perf_counter()))

    campaign = with_tools_begun(campaign, arm)
    choosing, held_out = SPLITS[options.holdout_by](campaign, options.seed)
    if options.holdout_by == "artefact" and not np.any(held_out):
        raise IdentificationError(
            f"no artefact of {len(campaign.artefacts)} can be kept aside; measure at "
            "several, or keep groups of poses aside (--holdout-by time)"
        )
    # Before the search, which would explain what is another arm's by effects.
    while campaign.prior is not None:
        fit = fitted(campaign, arm, choosing)
        contradicted = contradicted_expectation(fit.adjustment)
        if contradicted is None:
            break
        prior = campaign.prior.without(*contradicted)
        campaign = replace(campaign, prior=prior)
    decision = decide(campaign, arm, choosing, options, told)
    search = decision.search
    lap("decision")
    told("looking at the poses kept aside", 0.7)
    fits = _ledger_fits(decision, options)
    radius_mm = arm.probe.radius_mm
    blunders = held_out_blunders(fits[0].adjustment, held_out, radius_mm)

    def compared(fit: Fit) -> HoldoutComparison:
        """Compare a model with the one without terms, by the noise of all terms."""
        return compare_on_holdout(
            fits[0].adjustment,
            fit.adjustment,
            held_out,
            radius_mm,
            blunders=blunders,
            noise=search.fit.adjustment.network.noise,
        )

    gaps = [compared(fit) for fit in fits]
    vetoed = len(fits) > 1 and gaps[-1].is_worse
    accepted = frozenset[int]() if vetoed else _accepted(decision.names, options)
    # An arm file holds no effect whose epoch is not known.
    effects = search.fit.arm.effects
    writable = frozenset(at for at in accepted if has_epoch(effects[at], campaign))
    written = fits[0]
    if writable:
        kept, included = _kept(search, writable), search.fit.included
        written = search.fit
        if len(writable) < len(search.terms):
            written = refitted(search.fit, kept, included, snooping=False)
    lap("held-out poses")
    adapted, whole, rows = _adapted(campaign, search, accepted, options)
    lap("final estimates")
    misfit = find_misfit(search.fit.adjustment, held_out, blunders, radius_mm)
    if misfit is not None and not (search.is_finished or misfit.is_gross):
        # The terms say already that something is left.
        misfit = None
    terms = terms_of(
        decision,
        whole.arm,
        rows,
        options,
        accepted=accepted,
        choosing=choosing,
        misfit=misfit,
    )
    told("working out what could have been seen", 0.85)
    seen = detectable_of(search) if options.details else ()
    library = search.stage.findings[BankName.LIBRARY].projected
    n_visible = sum(one.shows_itself for one in library)
    lap("detectable sizes")
    return Diagnosis(
        verdict=verdict_of(terms, blind=n_visible == 0),
        n_library=len(library),
        n_visible=n_visible,
        terms=terms,
        arm=arm,
        adapted=adapted.arm,
        campaign=campaign,
        before=fits[0].adjustment,
        after=written.adjustment,
        all_terms=search.fit.adjustment,
        choosing=choosing,
        held_out=held_out,
        excluded=choosing & ~search.fit.included,
        blunders=blunders,
        gap=compared(written),
        ledger=_ledger(decision, fits, gaps),
        vetoed=vetoed,
        noise=noise_of(search),
        leftovers=leftovers_of(search),
        detectable=seen,
        seed=options.seed,
        holdout_by=options.holdout_by,
        seconds={done: end - start for (_, start), (done, end) in pairwise(laps)},
    )


def _ledger_fits(decision: Decision, options: DiagnosisOptions) -> list[Fit]:
    """Fit without terms, with the first, with the first two, and so on.

    For a decision alone only without terms and with all. All to the poses of the last
    one: what a missing effect spoils looks like blunders to a model without it, and
    would be left out where it hurts most.
    """
    search = decision.search
    if not search.terms:
        return [search.fit]
    effects = search.fit.arm.effects
    fits = [
        refitted(
            search.fit,
            effects[: search.n_given + count],
            search.fit.included,
            snooping=False,
        )
        for count in range(len(search.terms) if options.details else 1)
    ]
    return [*fits, search.fit]


def _ledger(
    decision: Decision, fits: list[Fit], gaps: list[HoldoutComparison]
) -> tuple[Step, ...]:
    added = [term.candidate.name for term in decision.search.terms]
    if len(fits) <= len(added):
        added = [", ".join(added)]
    names = [None, *added]
    return tuple(
        Step(name, gap.after, fit.adjustment.sigma0)
        for name, fit, gap in zip(names, fits, gaps, strict=True)
    )


def _accepted(
    names: tuple[NamedTerm, ...], options: DiagnosisOptions
) -> frozenset[int]:
    """Return the indices of the terms that enter the adapted arm."""
    return frozenset(
        naming.added.index
        for naming in names
        if naming.harmonic is None
        and not naming.is_oversized
        and (naming.status != "tentative" or options.accept_tentative)
    )


def _adapted(
    campaign: Campaign,
    search: SearchState,
    accepted: frozenset[int],
    options: DiagnosisOptions,
) -> tuple[Fit, Fit, ObservationEquations]:
    """Estimate everything again from all poses, with the accepted terms.

    The fit of the adapted arm, that with all terms, and the rows of the latter.
    """
    if not options.details:
        return search.fit, search.fit, search.stage.rows
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    whole = refitted(search.fit, search.fit.arm.effects, everyone)
    rows = equations_of(whole.adjustment)
    if search.serial is not None:
        rows = without_serial_noise(rows, search.serial)
    if len(accepted) == len(search.terms):
        return whole, whole, rows
    return refitted(search.fit, _kept(search, accepted), everyone), whole, rows


def _kept(search: SearchState, accepted: frozenset[int]) -> tuple[Effect, ...]:
    """List the effects that the arm had, and the accepted ones."""
    rejected = {term.index for term in search.terms} - accepted
    effects = search.fit.arm.effects
    return tuple(e for index, e in enumerate(effects) if index not in rejected)


_LOG_10 = float(np.log(10.0))
# The weakest first.
_STATUSES: tuple[Verdict, ...] = ("unknown", "tentative", "named")


def terms_of(
    decision: Decision,
    arm: Arm,
    rows: ObservationEquations,
    options: DiagnosisOptions,
    *,
    accepted: frozenset[int],
    choosing: Booleans,
    misfit: HoldoutMisfit | None,
) -> tuple[Term, ...]:
    """Tell of everything that was found, in the order of finding.

    Arm and rows are of a fit with all terms; its estimates are those of the terms.
    """
    search = decision.search
    terms = []
    for naming in decision.names:
        index = naming.added.index
        terms.append(
            Term(
                status=naming.status,
                candidate=_shown(naming),
                effect=arm.effects[index],
                estimates=estimates_of(rows, index),
                log_bayes_factor=naming.own.evidence,
                log10_p=naming.own.log_p / _LOG_10,
                harmonic=naming.harmonic,
                alternatives=naming.alternatives,
                separate_by=separate_by(naming, search.stage.rows, search.fit.arm)
                if options.details
                else "",
                accepted=index in accepted,
                is_oversized=naming.is_oversized,
            )
        )
    if search.stuck is not None:
        # A curve that tilts or shifts a joint: it cannot be added.
        terms.append(
            Term(
                status="unknown",
                candidate=search.stuck.candidate,
                log_bayes_factor=search.stuck.evidence,
                log10_p=search.stuck.log_p / _LOG_10,
            )
        )
    place = outlier_cluster(
        search.stage.rows,
        choosing,
        search.fit.included,
        options.n_draws,
        options.seed,
    )
    known = [(term.candidate.joint, term.candidate.covariate) for term in terms]
    if place is not None and (place.joint, place.covariate) not in known:
        at = _at_place(place.log_p, place.covariate, place.artefact, place.joint)
        terms.append(replace(at, cluster=place))
    elif misfit is not None and search.stuck is None:
        at = _at_place(misfit.log_p, ARTEFACT, misfit.artefact)
        terms.append(replace(at, misfit=misfit))
    return tuple(terms)


def _at_place(
    log_p: float, covariate: str, artefact: str | None, joint: str | None = None
) -> Term:
    """Report something unknown by its place, with the evidence of a p-value."""
    return Term(
        status="unknown",
        candidate=Candidate(
            bank=BankName.GENERIC,
            kind=Empirical.kind,
            joint=joint,
            covariate=covariate,
            artefact=artefact,
        ),
        log_bayes_factor=bayes_factor_bound(log_p),
        log10_p=log_p / _LOG_10,
    )


def bayes_factor_bound(log_p: float) -> float:
    """Compute the log of the largest evidence of a p-value, -1 / (e p log p).

    After Sellke, Bayarri and Berger (2001); none for p above 1/e.
    """
    return -1.0 - log_p - float(np.log(-log_p)) if log_p < -1.0 else 0.0


def _shown(naming: NamedTerm) -> Candidate:
    """Return the kind reported for a term: a harmonic with overtones is a curve."""
    candidate = naming.added.candidate
    if naming.harmonic is None:
        return candidate
    return replace(
        candidate,
        kind=Empirical.kind,
        order=None,
        component="angle",
        covariate=f"{candidate.joint}_rad",
    )


def verdict_of(terms: tuple[Term, ...], *, blind: bool) -> Verdict:
    """Return the verdict of the whole: that of its weakest term.

    Without terms it depends on whether the poses could show anything (not blind).
    """
    statuses = {term.status for term in terms}
    nothing: Verdict = "unknown" if blind else "clean"
    return next((one for one in _STATUSES if one in statuses), nothing)


def noise_of(search: SearchState) -> NoiseEstimate:
    """Return which noise was found."""
    noise = search.fit.adjustment.network.noise
    serial = search.serial or SerialCorrelation(share=0.0, phi=0.0)
    encoder_rad, contact_mm = noise.encoder_rad.tolist(), noise.contact_mm.tolist()
    oriented = np.any(search.fit.adjustment.network.campaign.poses.oriented)
    return NoiseEstimate(
        tuple(encoder_rad),
        tuple(contact_mm),
        noise.orientation_rad if oriented else None,
        serial.share,
        serial.phi,
    )


def leftovers_of(search: SearchState) -> tuple[BankRemainder, ...]:
    """Return the remaining significance in every bank."""
    found = []
    for name in BankName:
        choices = ranked(search.stage, (name,), search.joints_with_own_curve)
        if choices:
            first = min(choices, key=lambda choice: choice.log_p)
            threshold = search.thresholds[name] / _LOG_10
            found.append(
                BankRemainder(name, first.candidate, first.log_p / _LOG_10, threshold)
            )
    return tuple(found)


def detectable_of(search: SearchState) -> tuple[Detectable, ...]:
    """Compute the minimal detectable sizes."""
    rows, arm = search.stage.rows, search.fit.arm
    found = detectable(
        rows,
        search.stage.banks[BankName.LIBRARY],
        absent_candidates(rows, arm),
        search.thresholds[BankName.LIBRARY],
    )
    # What was found is in the model, and cannot be detected again.
    known = {term.candidate.identity for term in search.terms}
    return tuple(one for one in found if one.candidate.identity not in known)

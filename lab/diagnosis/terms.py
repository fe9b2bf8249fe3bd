"""The terms of a diagnosis with their verdicts, and the verdict of the whole."""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.lab.diagnosis.adaptation import Adaptation
from traverse.lab.diagnosis.advice.experiments import separate_by
from traverse.lab.diagnosis.model.covariates import outlier_cluster
from traverse.lab.diagnosis.model.fit import estimates_of, has_epoch
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.search.decision import Decision, exceeds_stated
from traverse.lab.diagnosis.search.forward_search import (
    DECIDED,
    ScoredCandidate,
    StuckCurve,
)
from traverse.lab.diagnosis.search.naming import (
    NamedTerm,
    correlation,
    of_single_joints,
    rivals_of,
)
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.outcomes.diagnosis import (
    Alternative,
    Estimate,
    HoldoutMisfit,
    Status,
    Term,
    Verdict,
)
from traverse.lab.statistics.outlier_clusters import ARTEFACT

_LOG_10 = float(np.log(10.0))
# The weakest first.
_STATUSES: tuple[Verdict, ...] = ("unknown", "unexplained", "tentative", "named")


def terms_of(
    decision: Decision,
    arm: Arm,
    rows: ObservationEquations,
    options: DiagnosisOptions,
    *,
    adaptation: Adaptation,
    choosing: Booleans,
    misfit: HoldoutMisfit | None,
    exceeded: float | None,
) -> tuple[Term, ...]:
    """Describe every term, in the order in which the search added them.

    Arm and rows are of a fit with all terms; its estimates are those of the terms.

    Strategy: a name stands on what is left being noise. Where poses kept aside are
    still several times the stated noise away, or are predicted better without it, what
    chose the name may as well be something that no candidate describes. Where they are
    nowhere near, arm file and campaign do not belong together: effects of a model that
    fits nothing are none, and only what is in the arm is listed beside that.
    """
    search = decision.search
    campaign = search.fit.adjustment.network.campaign
    terms = []
    is_gross = misfit is not None and misfit.is_gross
    is_unproven = exceeded is not None or is_gross
    for named in decision.names:
        index, naming = named.added.index, named
        is_accepted = index in adaptation.accepted
        if index in adaptation.unhelpful:
            naming = _beside_its_kind(named, decision.names)
        if naming.status == "named" and (is_unproven or index in adaptation.unhelpful):
            naming = replace(naming, status="tentative")
        terms.append(
            Term(
                status=naming.status,
                candidate=_shown(naming),
                effect=arm.effects[index],
                parameters=estimates_of(rows, index),
                log_bayes_factor=naming.choice.evidence,
                log10_p=naming.choice.log_p / _LOG_10,
                harmonic=naming.harmonic,
                alternatives=naming.alternatives,
                separate_by=separate_by(naming, search.stage.rows, search.fit.arm)
                if options.details
                else "",
                accepted=is_accepted,
                in_arm_file=is_accepted and has_epoch(arm.effects[index], campaign),
                oversized=naming.is_oversized,
                negative=naming.is_negative,
                helps=index not in adaptation.unhelpful,
            )
        )
    if misfit is not None and is_gross:
        kept = [term for term in terms if term.accepted]
        return (_of_misfit(misfit), *kept)
    place = outlier_cluster(
        search.stage.rows,
        choosing,
        search.fit.included,
        options.n_draws,
        options.seed,
    )
    leaves_noise = not (campaign.states_noise and exceeds_stated(search.unexplained))
    is_alone = place is None and leaves_noise
    terms += [_stuck_term(curve, is_alone=is_alone) for curve in search.stuck]
    known = [(term.candidate.joint, term.candidate.covariate) for term in terms]
    if place is not None and (place.joint, place.covariate) not in known:
        unknown = _at_place(place.log_p, place.covariate, place.artefact, place.joint)
        terms.append(replace(unknown, cluster=place))
    elif misfit is not None and not search.stuck:
        terms.append(_of_misfit(misfit))
    return tuple(terms)


def _of_misfit(misfit: HoldoutMisfit) -> Term:
    unknown = _at_place(misfit.log_p, ARTEFACT, misfit.artefact)
    return replace(unknown, misfit=misfit)


def _beside_its_kind(naming: NamedTerm, names: tuple[NamedTerm, ...]) -> NamedTerm:
    """Make a term of all joints a rival of those of its kind at single joints."""
    singles = of_single_joints(naming, names)
    if not singles or naming.status != "named":
        return naming
    rivals = tuple(
        Alternative(
            single.added.candidate,
            single.choice.evidence,
            correlation(
                naming.choice.projected,
                naming.choice.residuals,
                single.choice.projected,
            ),
            alias=False,
        )
        for single in singles
    )
    alternatives = (*naming.alternatives, *rivals)
    return replace(naming, status="tentative", alternatives=alternatives)


def _stuck_term(curve: StuckCurve, *, is_alone: bool) -> Term:
    """Report a curve that tilts or shifts: it cannot be added.

    That an artefact moves is a name, where nothing else is left; nothing of it belongs
    into an arm.
    """
    status: Status = "unknown"
    stuck = curve.choice
    rivals = rivals_of(stuck, curve.choices, stuck.score)
    if stuck.candidate.artefact is not None:
        near = [
            rival
            for rival in rivals
            if rival.log_bayes_factor > stuck.evidence - DECIDED and not rival.alias
        ]
        status = "named" if is_alone and not near else "tentative"
    return Term(
        status=status,
        candidate=stuck.candidate,
        parameters=_stuck_estimates(stuck),
        log_bayes_factor=stuck.evidence,
        log10_p=stuck.log_p / _LOG_10,
        alternatives=rivals,
    )


def _stuck_estimates(stuck: ScoredCandidate) -> dict[str, Estimate]:
    """Estimate the curves along each direction, `shift_mm.x` and so on."""
    values, cofactors = stuck.projected.amplitudes(stuck.residuals)
    stds = np.sqrt(np.diag(cofactors))
    names = [name.rpartition(".")[0] for name in stuck.candidate.parameters]
    estimates = {}
    for name in dict.fromkeys(names):
        positions = [n for n, other in enumerate(names) if other == name]
        unit = "mm" if name.startswith("shift") else "rad"
        estimates[name] = Estimate(
            tuple(values[positions]), tuple(stds[positions]), unit
        )
    return estimates


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


def verdict_of(
    terms: tuple[Term, ...],
    *,
    blind: bool = False,
    exceeded: float | None,
    is_all_noise: bool = True,
) -> Verdict:
    """Return the verdict of the whole: that of its weakest term.

    Without terms it depends on whether the poses could show anything (not blind), and
    on whether all that is left is noise. What exceeds the stated noise several times is
    not explained by any name.
    """
    statuses: set[Verdict] = {term.status for term in terms}
    if exceeded is not None:
        statuses.add("unexplained")
    nothing: Verdict = "clean" if is_all_noise else "unexplained"
    if blind:
        nothing = "unknown"
    return next((status for status in _STATUSES if status in statuses), nothing)

"""The outcome of a search in the values of a diagnosis."""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.lab.diagnosis.advice.experiments import separate_by
from traverse.lab.diagnosis.advice.minimal_detectable import detectable
from traverse.lab.diagnosis.candidates.library import absent_candidates
from traverse.lab.diagnosis.model.candidate import BankName, Candidate
from traverse.lab.diagnosis.model.covariates import outlier_cluster
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.diagnosis.model.result import (
    BankRemainder,
    Detectable,
    DiagnosisOptions,
    HoldoutMisfit,
    NoiseEstimate,
    Term,
    Verdict,
)
from traverse.lab.diagnosis.model.terms import estimates_of
from traverse.lab.diagnosis.search.decision import Decision
from traverse.lab.diagnosis.search.forward_search import SearchState
from traverse.lab.diagnosis.search.naming import NamedTerm
from traverse.lab.diagnosis.search.selection import ranked
from traverse.lab.statistics.outlier_clusters import ARTEFACT

_LOG_10 = float(np.log(10.0))
# The weakest first.
_STATUSES: tuple[Verdict, ...] = ("unknown", "tentative", "named")


def terms_of(
    decision: Decision,
    accepted: tuple[bool, ...],
    rows: ObservationEquations,
    choosing: Booleans,
    options: DiagnosisOptions,
    *,
    misfit: HoldoutMisfit | None,
) -> tuple[Term, ...]:
    """Tell of everything that was found, in the order of finding.

    The rows are of a fit with all terms; their estimates are those of the terms.
    """
    search = decision.search
    whole = rows.adjustment.network.parameters.effects
    terms = []
    for naming, is_accepted in zip(decision.names, accepted, strict=True):
        index = naming.added.index
        if whole is None:
            raise ValueError("terms without effects in the fit")
        values = rows.adjustment.state.arm.amplitudes
        correction = whole.at(values[-len(whole.effects.values) :]).corrections[index]
        effect = search.fit.arm.effects[index]
        terms.append(
            Term(
                status=naming.status,
                candidate=_shown(naming),
                effect=effect.model_copy(update=correction.keys),
                estimates=estimates_of(rows, index),
                log_bayes_factor=naming.own.evidence,
                log10_p=naming.own.log_p / _LOG_10,
                harmonic=naming.harmonic,
                alternatives=naming.alternatives,
                separate_by=separate_by(naming, search.stage.rows, search.fit.arm)
                if options.details
                else "",
                accepted=is_accepted,
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
    noise, serial = search.fit.adjustment.network.noise, search.serial
    return NoiseEstimate(
        tuple(noise.encoder_rad.tolist()),
        tuple(noise.contact_mm.tolist()),
        0.0 if serial is None else serial.share,
        0.0 if serial is None else serial.phi,
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

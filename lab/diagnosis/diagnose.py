"""Diagnosis: find what the model lacks, name it, add it, show that the gap shrank."""

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from kinematics.arm_file import Arm
from lab.campaign import Campaign
from lab.diagnosis.advice import separate_by
from lab.diagnosis.candidate import BankName, Candidate
from lab.diagnosis.choice import Choice, ranked
from lab.diagnosis.decision import Decision, decided
from lab.diagnosis.detectable import detectable
from lab.diagnosis.diagnosis import (
    Detectable,
    Diagnosis,
    Leftover,
    NoiseFound,
    Step,
    Term,
    Verdict,
)
from lab.diagnosis.fit import Fit
from lab.diagnosis.gap import Gap, gap_between
from lab.diagnosis.holdout import split
from lab.diagnosis.library import absent_candidates
from lab.diagnosis.naming import Naming
from lab.diagnosis.options import DiagnosisOptions
from lab.diagnosis.rows import Rows, rows_of
from lab.diagnosis.search import Progress, Search, refitted
from lab.diagnosis.serial import without_serial_noise
from lab.diagnosis.terms import estimates_of

__all__ = ["DiagnosisOptions", "diagnose"]

Booleans = NDArray[np.bool_]

_LOG_10 = float(np.log(10.0))
# The weakest first.
_STATUSES: tuple[Verdict, ...] = ("unknown", "tentative", "named")


def diagnose(
    campaign: Campaign,
    arm: Arm,
    options: DiagnosisOptions | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose an arm.

    Args:
        campaign: What was measured.
        arm: The design, or an identified arm; the geometry and all effects that it
            has already are estimated together with what is added.
        options: Wishes.
        progress: Told what is done, and which part of the work that is (0 to 1).

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    options = options or DiagnosisOptions()
    told = progress or _nobody
    clock = _Clock()
    choosing, held_out = split(campaign, options.seed)
    decision = decided(campaign, arm, choosing, options, told)
    search = decision.search
    clock.lap("decision")
    told("looking at the poses kept aside", 0.7)
    fits = _ledger_fits(decision)
    gaps = [
        gap_between(fit.adjustment, fits[-1].adjustment, held_out, arm.probe.radius_mm)
        for fit in fits
    ]
    gap = gaps[0]
    clock.lap("held-out poses")
    accepted = _accepted(decision.names, gap, options)
    adapted, rows = _adapted(campaign, decision, accepted, options)
    clock.lap("final estimates")
    terms = _terms(decision, accepted, rows, options)
    told("working out what could have been seen", 0.85)
    seen = _detectable(search) if options.details else ()
    clock.lap("detectable sizes")
    return Diagnosis(
        verdict=_verdict(terms),
        terms=terms,
        arm=arm,
        adapted=adapted.arm,
        campaign=campaign,
        before=fits[0].adjustment,
        after=search.fit.adjustment,
        choosing=choosing,
        held_out=held_out,
        excluded=choosing & ~search.fit.included,
        ledger=_ledger(decision, fits, gaps),
        closed=gap.closed if terms else None,
        vetoed=bool(terms) and gap.is_worse,
        noise=_noise(search),
        leftovers=_leftovers(search),
        detectable=seen,
        seed=options.seed,
        seconds=clock.laps,
    )


def _ledger_fits(decision: Decision) -> list[Fit]:
    """Fit without terms, with the first, with the first two, and so on.

    All to the poses of the last one: what a missing effect spoils looks like blunders
    to a model without it, and would be left out where it hurts most.
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
        for count in range(len(search.terms))
    ]
    return [*fits, search.fit]


def _ledger(decision: Decision, fits: list[Fit], gaps: list[Gap]) -> tuple[Step, ...]:
    names = [None, *(term.candidate.name for term in decision.search.terms)]
    return tuple(
        Step(name, gap.before, fit.adjustment.sigma0)
        for name, fit, gap in zip(names, fits, gaps, strict=True)
    )


def _accepted(
    names: tuple[Naming, ...], gap: Gap, options: DiagnosisOptions
) -> tuple[bool, ...]:
    """Say which terms enter the adapted arm."""
    if gap.is_worse:
        return (False,) * len(names)
    return tuple(
        naming.harmonic is None
        and (naming.status != "tentative" or options.accept_tentative)
        for naming in names
    )


def _adapted(
    campaign: Campaign,
    decision: Decision,
    accepted: tuple[bool, ...],
    options: DiagnosisOptions,
) -> tuple[Fit, Rows]:
    """Estimate everything again from all poses, with the accepted terms.

    Returns:
        The fit of the adapted arm, and the rows of a fit with all terms.
    """
    search = decision.search
    if not options.details:
        return search.fit, search.stage.rows
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    effects = search.fit.arm.effects
    whole = refitted(search.fit, effects, everyone)
    rows = rows_of(whole.adjustment)
    if search.serial is not None:
        rows = without_serial_noise(rows, search.serial)
    if all(accepted):
        return whole, rows
    kept = tuple(
        effect
        for index, effect in enumerate(effects)
        if index < search.n_given or accepted[index - search.n_given]
    )
    return refitted(search.fit, kept, everyone), rows


def _terms(
    decision: Decision,
    accepted: tuple[bool, ...],
    rows: Rows,
    options: DiagnosisOptions,
) -> tuple[Term, ...]:
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
            )
        )
    if search.stuck is not None:
        terms.append(_without_form(search.stuck))
    return tuple(terms)


def _without_form(stuck: Choice) -> Term:
    """Tell of a curve that tilts or shifts a joint: it cannot be added."""
    return Term(
        status="unknown",
        candidate=stuck.candidate,
        effect=None,
        estimates={},
        log_bayes_factor=stuck.evidence,
        log10_p=stuck.log_p / _LOG_10,
        harmonic=None,
        alternatives=(),
        separate_by="",
        accepted=False,
    )


def _shown(naming: Naming) -> Candidate:
    """Say as what a term is told: a harmonic with overtones is a curve."""
    candidate = naming.added.candidate
    if naming.harmonic is None:
        return candidate
    return replace(
        candidate,
        kind="empirical",
        order=None,
        component="angle",
        covariate=f"{candidate.joint}_rad",
    )


def _verdict(terms: tuple[Term, ...]) -> Verdict:
    statuses = {term.status for term in terms}
    return next((one for one in _STATUSES if one in statuses), "clean")


def _noise(search: Search) -> NoiseFound:
    noise, serial = search.fit.adjustment.network.noise, search.serial
    return NoiseFound(
        tuple(noise.encoder_rad.tolist()),
        tuple(noise.contact_mm.tolist()),
        0.0 if serial is None else serial.share,
        0.0 if serial is None else serial.phi,
    )


def _leftovers(search: Search) -> tuple[Leftover, ...]:
    found = []
    for name in BankName:
        choices = ranked(search.stage, (name,), search.settled)
        if choices:
            first = min(choices, key=lambda choice: choice.log_p)
            threshold = search.thresholds[name] / _LOG_10
            found.append(
                Leftover(name, first.candidate, first.log_p / _LOG_10, threshold)
            )
    return tuple(found)


def _detectable(search: Search) -> tuple[Detectable, ...]:
    rows, arm = search.stage.rows, search.fit.arm
    found = detectable(
        rows,
        search.stage.banks[BankName.LIBRARY],
        absent_candidates(rows, arm),
        search.thresholds[BankName.LIBRARY],
    )
    # What was found is in the model, where it cannot be seen once more.
    known = {term.candidate.identity for term in search.terms}
    return tuple(one for one in found if one.candidate.identity not in known)


def _nobody(_what: str, _part: float) -> None:
    """Take no notice of progress."""


class _Clock:
    """Seconds by stage of the work."""

    def __init__(self) -> None:
        self._last = perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str) -> None:
        """Note what has just been done."""
        now = perf_counter()
        self._laps[name] = now - self._last
        self._last = now

    @property
    def laps(self) -> Mapping[str, float]:
        """As noted."""
        return dict(self._laps)

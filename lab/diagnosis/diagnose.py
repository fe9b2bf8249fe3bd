"""Diagnosis: find what the model lacks, name it, add it, show that the gap shrank."""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import SPLITS, at_most
from traverse.lab.diagnosis.adaptation import (
    adaptation,
    final_estimates,
    other_scale_of,
)
from traverse.lab.diagnosis.advice.minimal_detectable import detectable
from traverse.lab.diagnosis.candidates.library import absent_candidates
from traverse.lab.diagnosis.holdout.comparison import (
    compare_on_holdout,
    find_misfit,
    held_out_blunders,
    is_noise,
    noise_exceeded,
)
from traverse.lab.diagnosis.model.fit import Fit, begin, fitted
from traverse.lab.diagnosis.model.result import (
    Diagnosis,
    DiagnosisOptions,
    HoldoutComparison,
    NoiseEstimate,
)
from traverse.lab.diagnosis.model.serial_noise import SerialCorrelation
from traverse.lab.diagnosis.search.decision import Decision, decide
from traverse.lab.diagnosis.search.forward_search import (
    Progress,
    SearchState,
    no_progress,
    ranked,
    refitted,
)
from traverse.lab.diagnosis.terms import terms_of, verdict_of
from traverse.lab.outcomes.candidate import BankName
from traverse.lab.outcomes.common_conditions import is_many
from traverse.lab.outcomes.diagnosis import BankRemainder, Detectable, LedgerLine

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

    Examples:
        The ring of the third encoder is off its centre, so that it reads up to 0.2 mrad
        too much. A tracker saw the ball in 120 postures, to 10 micrometres.

        >>> from importlib.resources import files
        >>> from traverse.kinematics.arm_file.arm import read_arm
        >>> from traverse.kinematics.model.forward import probe_centre
        >>> from traverse.kinematics.model.geometry import geometry_from_arm
        >>> from traverse.lab.campaign.campaign import campaign_of_places
        >>> arm = read_arm(files("traverse.cli") / "demo_data" / "arm.toml")
        >>> rng = np.random.default_rng(1)
        >>> angles_rad = rng.uniform(-2.0, 2.0, (120, 7))
        >>> places_mm = probe_centre(geometry_from_arm(arm), angles_rad)
        >>> places_mm += rng.normal(0.0, 0.01, places_mm.shape)
        >>> readings_rad = angles_rad.copy()
        >>> readings_rad[:, 2] += 2e-4 * np.cos(angles_rad[:, 2])
        >>> campaign = campaign_of_places(
        ...     [joint.name for joint in arm.joints],
        ...     readings_rad,
        ...     places_mm,
        ...     encoder_rad=1e-6,
        ...     contact_mm=0.01,
        ... )
        >>> diagnosis = diagnose(campaign, arm, DiagnosisOptions(details=False))
        >>> diagnosis.verdict, [term.candidate.name for term in diagnosis.terms]
        ('named', ['encoder_eccentricity J3'])
        >>> estimate = diagnosis.terms[0].parameters["cos_rad"]
        >>> f"{abs(estimate.value):.5f} rad"
        '0.00020 rad'
    """
    options = options or DiagnosisOptions()
    report = progress or no_progress
    beginning = begin(campaign, arm)
    campaign, start = beginning.campaign, beginning.arm
    choosing, held_out = SPLITS[options.holdout_by](campaign, options.seed)
    if options.holdout_by == "artefact" and not np.any(held_out):
        raise IdentificationError(
            f"no artefact of {len(campaign.artefacts)} can be kept aside; measure at "
            "several, or keep groups of poses aside (--holdout-by time)"
        )
    choosing = at_most(campaign, choosing, options.seed)
    # Before the search, which would explain what is another arm's by effects.
    while campaign.prior is not None:
        fit = fitted(campaign, start, choosing)
        contradicted = fit.adjustment.contradicted_expectation()
        if contradicted is None:
            break
        prior = campaign.prior.without(*contradicted)
        campaign = replace(campaign, prior=prior)
    decision = decide(campaign, start, choosing, options, report)
    search = decision.search
    report("looking at the poses kept aside", 0.7)
    fits = _ledger_fits(decision, options)
    blunders = held_out_blunders(fits[0].adjustment, held_out)

    def compared(fit: Fit) -> HoldoutComparison:
        """Compare a model with the one without terms, by the noise of all terms."""
        return compare_on_holdout(
            fits[0].adjustment,
            fit.adjustment,
            held_out,
            blunders=blunders,
            noise=search.fit.adjustment.network.noise,
        )

    gaps = [compared(fit) for fit in fits]
    adapted = adaptation(decision, fits, compared, choosing, options)
    estimates = final_estimates(campaign, search, adapted.accepted, options)
    misfit = find_misfit(search.fit.adjustment, held_out, blunders)
    if misfit is not None and not (search.is_finished or misfit.is_gross):
        # The terms say already that something is left.
        misfit = None
    exceeded = noise_exceeded(campaign, gaps[-1].after, search.fit.adjustment)
    terms = terms_of(
        decision,
        estimates.with_all_terms.arm,
        estimates.rows,
        options,
        adaptation=adapted,
        choosing=choosing,
        misfit=misfit,
        exceeded=exceeded,
    )
    report("working out what could have been seen", 0.85)
    seen = detectable_of(search) if options.details else ()
    library = search.stage.findings[BankName.LIBRARY].projected
    n_visible = sum(candidate.shows_itself for candidate in library)
    excluded = choosing & ~search.fit.included
    left_out = _left_out(estimates.adapted, choosing, options)
    return Diagnosis(
        verdict=verdict_of(
            terms,
            blind=n_visible == 0,
            exceeded=exceeded,
            is_all_noise=is_noise(adapted.gap.after)
            and not is_many(int(np.sum(excluded | left_out)), len(left_out)),
        ),
        n_library=len(library),
        n_visible=n_visible,
        terms=terms,
        arm=arm,
        design=beginning.design,
        wrong_signs=beginning.wrong_signs,
        zero_offsets_rad=beginning.zero_offsets_rad,
        adapted=estimates.adapted.arm,
        campaign=campaign,
        before=fits[0].adjustment,
        after=adapted.written.adjustment,
        all_terms=search.fit.adjustment,
        choosing=choosing,
        held_out=held_out,
        excluded=excluded,
        left_out=left_out,
        final=estimates.adapted,
        other_scale=other_scale_of(decision, adapted.accepted, estimates.adapted),
        exceeded=exceeded,
        is_identified_anew=adapted.is_identified_anew,
        blunders=blunders,
        gap=adapted.gap,
        ledger=_ledger(decision, fits, gaps),
        vetoed=adapted.vetoed,
        noise=noise_of(search),
        leftovers=leftovers_of(search),
        detectable=seen,
        seed=options.seed,
        holdout_by=options.holdout_by,
    )


def _left_out(final: Fit, choosing: Booleans, options: DiagnosisOptions) -> Booleans:
    """Say which poses the last estimates leave out, (n_poses,).

    A decision alone has none from all poses.
    """
    eligible = np.ones_like(choosing) if options.details else choosing
    return eligible & ~final.included


def _ledger_fits(decision: Decision, options: DiagnosisOptions) -> tuple[Fit, ...]:
    """Fit without terms, with the first, with the first two, and so on.

    For a decision alone only without terms and with all. All to the poses of the last
    one: what a missing effect spoils looks like blunders to a model without it, and
    would be left out where it hurts most.
    """
    search = decision.search
    if not search.terms:
        return (search.fit,)
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
    return (*fits, search.fit)


def _ledger(
    decision: Decision, fits: tuple[Fit, ...], gaps: list[HoldoutComparison]
) -> tuple[LedgerLine, ...]:
    added = [term.candidate.name for term in decision.search.terms]
    if len(fits) <= len(added):
        added = [", ".join(added)]
    names = [None, *added]
    return tuple(
        LedgerLine(name, fit.adjustment.sigma0, gap.after)
        for name, fit, gap in zip(names, fits, gaps, strict=True)
    )


def noise_of(search: SearchState) -> NoiseEstimate:
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


_LOG_10 = float(np.log(10.0))


def leftovers_of(search: SearchState) -> tuple[BankRemainder, ...]:
    remainders = []
    for name in BankName:
        choices = ranked(search.stage, (name,), search.joints_with_own_curve)
        if choices:
            first = min(choices, key=lambda choice: choice.log_p)
            threshold = search.thresholds[name] / _LOG_10
            remainders.append(
                BankRemainder(first.candidate, name, first.log_p / _LOG_10, threshold)
            )
    return tuple(remainders)


def detectable_of(search: SearchState) -> tuple[Detectable, ...]:
    rows, arm = search.stage.rows, search.fit.arm
    sizes = detectable(
        rows,
        search.stage.banks[BankName.LIBRARY],
        absent_candidates(rows, arm),
        search.thresholds[BankName.LIBRARY],
    )
    # What was found is in the model, and cannot be detected again.
    known = {term.candidate.identity for term in search.terms}
    return tuple(size for size in sizes if size.candidate.identity not in known)

"""State of a diagnosis and its reasons, for command line, JSON, page, exit status."""

from collections.abc import Sequence

import numpy as np

from traverse.lab.diagnosis.model.fit import terms_without_epoch
from traverse.lab.diagnosis.model.result import Diagnosis, HoldoutResult
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Outcome,
    Shortfall,
    State,
    judge,
)
from traverse.lab.report.quantities import length_mm
from traverse.plurals import counted

Finding = Established | Sequence[Shortfall]

# Standard deviations of a mean square of noise alone.
_OPEN_GAP = 4.0
_MANY_EXCLUDED = 0.1


def outcome_of(diagnosis: Diagnosis) -> Outcome:
    """Judge a diagnosis by the table of its conditions."""
    return judge(CONDITIONS, diagnosis)


def _last(diagnosis: Diagnosis) -> HoldoutResult:
    return diagnosis.gap.after.without_blunders or diagnosis.gap.after


def _visible(diagnosis: Diagnosis) -> Finding:
    values = {"n_visible": diagnosis.n_visible, "n_effects": diagnosis.n_library}
    if not diagnosis.blind:
        return Established(values)
    return [
        Shortfall(
            "These poses could show no effect of the library.",
            "Measure more poses, in varied postures.",
            values,
            State.BAD,
        )
    ]


def _named(diagnosis: Diagnosis) -> Finding:
    counts = {
        f"n_{status}": sum(term.status == status for term in diagnosis.terms)
        for status in ("named", "tentative", "unknown")
    }
    if counts["n_unknown"]:
        return [
            Shortfall(
                "Something is missing that has no name.",
                "Look at what joint, reading or artefact the report names.",
                counts,
                State.BAD,
            )
        ]
    if counts["n_tentative"]:
        return [
            Shortfall(
                "More than one name fits.",
                "Measure what the report proposes to separate them.",
                counts,
            )
        ]
    return Established(counts)


def _within_noise(diagnosis: Diagnosis) -> Finding:
    last = _last(diagnosis)
    values = {"held_out_chi2": last.chi2, "held_out_rms_mm": last.rms_mm}
    if diagnosis.exceeded is not None:
        beyond = (
            f"What is left is {diagnosis.exceeded:.3g} times the mean square that the "
            "stated noise explains"
        )
        if diagnosis.verdict != "unexplained":
            # Something was found that no arm file holds.
            return [
                Shortfall(
                    f"{beyond}, by whatever the arm file cannot hold or does not have.",
                    "Mend what was found, and measure again.",
                    {**values, "times_stated": diagnosis.exceeded},
                    State.BAD,
                )
            ]
        return [
            Shortfall(
                f"{beyond}, without a pattern that any effect, curve or harmonic "
                "describes: the noise is stated too small, or there is a fault without "
                "a pattern.",
                "Touch one place many times in one posture: if these points scatter as "
                "stated, look for play, loose parts and whatever else the campaign has "
                "no column for.",
                {**values, "times_stated": diagnosis.exceeded},
                State.BAD,
            )
        ]
    if last.n == 0:
        return [
            Shortfall(
                "No pose could be kept aside, so that nothing proves the result.",
                "Measure more poses.",
            )
        ]
    if last.chi2 > 1.0 + _OPEN_GAP * float(np.sqrt(2.0 / last.n)):
        return [
            Shortfall(
                "The poses kept aside still differ from the model by "
                f"{length_mm(last.rms_mm)} rms, {last.chi2:.2g} times the mean square "
                "that noise explains: something is missing in the arm file.",
                "Measure again, where the discrepancies are largest.",
                values,
            )
        ]
    return Established(values)


def _helps(diagnosis: Diagnosis) -> Finding:
    first, last = diagnosis.ledger[0].held_out, diagnosis.ledger[-1].held_out
    values = {"held_out_chi2_before": first.chi2, "held_out_chi2_after": last.chi2}
    if diagnosis.vetoed:
        return [
            Shortfall(
                "The poses kept aside are predicted worse with what was found than "
                "without: nothing was added to the arm.",
                "Measure again, or more.",
                values,
                State.BAD,
            )
        ]
    if diagnosis.is_identified_anew:
        return [
            Shortfall(
                "The arm as identified, without what was found, predicts the poses "
                "kept aside better than the one with it, and is what is written.",
                "Measure again, or more.",
                values,
            )
        ]
    return Established(values)


def _written(diagnosis: Diagnosis) -> Finding:
    named = [
        term for term in diagnosis.terms if term.status == "named" and not term.accepted
    ]
    of_artefacts = [term for term in named if term.candidate.artefact is not None]
    unwritten = [term for term in named if term not in of_artefacts]
    shortfalls = [
        Shortfall(
            f"The artefact {term.candidate.artefact} is at fault, not the arm.",
            "Fasten it or state it rightly, and measure again.",
        )
        for term in of_artefacts
    ]
    shortfalls += [
        Shortfall(
            f"{term.candidate.name} is not in the adapted arm"
            + (
                ": poses kept aside are predicted no better with it."
                if term.is_unhelpful
                else "."
            ),
            "Do not expect the written arm to measure better by it.",
        )
        for term in unwritten
    ]
    why, remedy = (
        "the campaign does not say when it began",
        "Give start_utc in campaign.toml.",
    )
    if diagnosis.campaign.time_is_order:
        why, remedy = "the times of poses are their order", "Give times of the poses."
    shortfalls += [
        Shortfall(
            f"{term.candidate.name} is not written to the arm file: it is bound to "
            f"time, and {why}.",
            remedy,
        )
        for term in terms_without_epoch(diagnosis)
    ]
    n_written = sum(term.accepted for term in diagnosis.terms)
    return shortfalls or Established({"n_written": n_written})


def _scaled(diagnosis: Diagnosis) -> Finding:
    """Look whether a length is known, here or where the arm was identified."""
    adjustment = diagnosis.after
    lost = adjustment.network.undetermined_scale(adjustment.state.arm)
    if len(lost) == 0 or diagnosis.arm.identification is not None:
        return Established({"from_campaign": len(lost) == 0})
    return [
        Shortfall(
            "The scale of the arm is undetermined: no length is known in this "
            "campaign, and the arm file is a design. The written arm has the design's "
            "scale.",
            "Add a length standard, or diagnose an arm that was identified with one.",
        )
    ]


def _agreeing(diagnosis: Diagnosis) -> Finding:
    n_all = len(diagnosis.campaign.poses)
    n_excluded = int(np.count_nonzero(diagnosis.excluded | diagnosis.left_out))
    values = {"n_left_out": n_excluded, "n_poses": n_all}
    if n_excluded <= _MANY_EXCLUDED * n_all:
        return Established(values)
    return [
        Shortfall(
            f"{n_excluded} of {counted(n_all, 'pose')} contradict the others and took "
            "no part.",
            "Find out why before the arm is used.",
            values,
        )
    ]


def _in_family(diagnosis: Diagnosis) -> Finding:
    prior = diagnosis.campaign.prior
    if prior is None or not prior.contradicted:
        return Established()
    names = ", ".join(name for name, _ in prior.contradicted)
    return [
        Shortfall(
            f"The measurements contradict the family {prior.family} in {names}.",
            "Look whether the arm is of that family.",
            {f"sigmas_of_{name}": sigmas for name, sigmas in prior.contradicted},
        )
    ]


CONDITIONS: tuple[Condition[Diagnosis], ...] = (
    Condition("visible", "the poses could show effects", _visible),
    Condition("named", "whatever is missing has one name", _named),
    Condition("within_noise", "noise explains what is left", _within_noise),
    Condition("helps", "poses kept aside are predicted no worse", _helps),
    Condition("written", "everything that has a name is in the arm", _written),
    Condition("scale", "the scale of the arm is known", _scaled),
    Condition("agreeing", "nearly all poses agree", _agreeing),
    Condition("in_family", "the arm is like its family", _in_family),
)
"""What has to be established for a diagnosis to be good."""

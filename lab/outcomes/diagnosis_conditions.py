"""What must be established before a diagnosis is good."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from traverse.lab.outcomes.arm_file import signs_and_zeros
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    bad,
    doubt,
    judge,
)
from traverse.lab.outcomes.diagnosis import DiagnosisFigures, HoldoutResult
from traverse.lab.outcomes.repeats import no_repeats
from traverse.lab.report.quantities import length_mm
from traverse.plurals import counted


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisEvidence:
    """What the conditions look at: the figures, and what they rest on.

    Attributes:
        converged: Whether the estimates of the arm that is written did.
        n_repeated: Poses with exactly the readings of another.
        time_is_order: Whether the campaign has no times.
        has_length: Whether a length is known in the campaign.
        holds_scale: Whether the design's scale is held all the same.
        was_identified: Whether the arm file was.
        undetermined_mm: How far the probe moves by combinations of parameters that the
            poses do not determine, where the design is off by a plausible deviation.
        contradicted: Parameters of the family that the poses contradict, in sigmas.
    """

    figures: DiagnosisFigures
    converged: bool
    n_poses: int
    n_repeated: int
    time_is_order: bool
    has_length: bool
    holds_scale: bool
    was_identified: bool
    undetermined_mm: float
    contradicted: Sequence[tuple[str, float]] = field(default=())


def judge_diagnosis(evidence: DiagnosisEvidence) -> Outcome:
    return judge(CONDITIONS, evidence)


# Standard deviations of a mean square of noise alone.
_OPEN_GAP = 4.0
_MANY_EXCLUDED = 0.1


def is_noise(figures: HoldoutResult) -> bool:
    """Return whether noise explains how poses kept aside are predicted."""
    last = figures.without_blunders or figures
    return last.n == 0 or not _is_beyond(last.chi2, last.chi2_std)


def _is_beyond(chi2: float, std: float) -> bool:
    return chi2 > 1.0 + _OPEN_GAP * std


def is_many(n_excluded: int, n_poses: int) -> bool:
    """Return whether more poses contradict the others than blunders may be."""
    return n_excluded > _MANY_EXCLUDED * n_poses


def _converged(evidence: DiagnosisEvidence) -> Finding:
    if evidence.converged:
        return Established()
    return bad(
        "The estimates of the adapted arm did not converge: none of them may be used.",
        "Measure more and more varied postures; traverse identify names what moves.",
    )


def _belongs(evidence: DiagnosisEvidence) -> Finding:
    for term in evidence.figures.terms:
        if term.misfit is not None and term.misfit.is_gross:
            rms_mm = term.misfit.figures.rms_mm
            return bad(
                f"Poses kept aside are {length_mm(rms_mm)} from where the model puts "
                "them: arm file and campaign do not belong together, or the poses are "
                "too few.",
                "Check order, signs and zeros of the joints, and measure more poses.",
                {"rms_mm": rms_mm},
            )
    return Established()


def _file_fits(evidence: DiagnosisEvidence) -> Finding:
    figures = evidence.figures
    return signs_and_zeros(figures.wrong_signs, figures.zero_offsets_rad)


def _visible(evidence: DiagnosisEvidence) -> Finding:
    visible = evidence.figures.visible
    values = {"n_visible": visible["n"], "n_effects": visible["of"]}
    if visible["n"] > 0:
        return Established(values)
    return bad(
        "These poses could show no effect of the library.",
        "Measure more poses, in varied postures.",
        values,
    )


def _named(evidence: DiagnosisEvidence) -> Finding:
    counts = {
        f"n_{status}": sum(term.status == status for term in evidence.figures.terms)
        for status in ("named", "tentative", "unknown")
    }
    if counts["n_unknown"]:
        return bad(
            "Something is missing that has no name.",
            "Look at what joint, reading or artefact the report names.",
            counts,
        )
    if counts["n_tentative"]:
        return doubt(
            "More than one name fits, or a name is not certain.",
            "Measure what the report proposes to separate them.",
            counts,
        )
    return Established(counts)


def _within_noise(evidence: DiagnosisEvidence) -> Finding:
    figures = evidence.figures
    gap, exceeded = figures.gap, figures.times_stated_noise
    gap = gap.without_blunders or gap
    chi2, rms_mm = gap.held_out_chi2.after, gap.held_out_rms_mm.after
    values = {"held_out_chi2": chi2, "held_out_rms_mm": rms_mm}
    if exceeded is not None:
        beyond = (
            f"What is left is {exceeded:.3g} times the mean square that the "
            "stated noise explains"
        )
        if figures.verdict != "unexplained":
            # Something was found that no arm file holds.
            return bad(
                f"{beyond}, by whatever the arm file cannot hold or does not have.",
                "Mend what was found, and measure again.",
                {**values, "times_stated": exceeded},
            )
        return bad(
            f"{beyond}, without a pattern that any effect, curve or harmonic "
            "describes: the noise is stated too small, or there is a fault without "
            "a pattern.",
            "Touch one place many times in one posture: if these points scatter as "
            "stated, look for play, loose parts and whatever else the campaign has "
            "no column for.",
            {**values, "times_stated": exceeded},
        )
    if gap.n == 0 or chi2 is None or rms_mm is None:
        return doubt(
            "No pose could be kept aside, so that nothing proves the result.",
            "Measure more poses.",
        )
    if _is_beyond(chi2, gap.held_out_chi2_std):
        return doubt(
            "The poses kept aside still differ from the model by "
            f"{length_mm(rms_mm)} rms, {chi2:.2g} times the mean square "
            "that noise explains: the noise is larger than was thought, or something "
            "is missing in the arm file.",
            "Measure again, where the discrepancies are largest.",
            values,
        )
    return Established(values)


def _helps(evidence: DiagnosisEvidence) -> Finding:
    figures = evidence.figures
    values = {
        "held_out_chi2_before": figures.ledger[0].held_out_chi2,
        "held_out_chi2_after": figures.ledger[-1].held_out_chi2,
    }
    if figures.vetoed:
        return bad(
            "The poses kept aside are predicted worse with what was found than "
            "without: nothing was added to the arm.",
            "Measure again, or more.",
            values,
        )
    if figures.identified_anew:
        return doubt(
            "The arm as identified, without what was found, predicts the poses "
            "kept aside better than the one with it, and is what is written.",
            "Measure again, or more.",
            values,
        )
    return Established(values)


def _written(evidence: DiagnosisEvidence) -> Finding:
    terms = evidence.figures.terms
    shortfalls = [
        Shortfall(
            f"The artefact {term.candidate.artefact} is at fault, not the arm.",
            "Fasten it or state it rightly, and measure again.",
        )
        for term in terms
        if term.status == "named" and not term.accepted
    ]
    why, remedy = (
        "the campaign does not say when it began",
        "Give start_utc in campaign.toml.",
    )
    if evidence.time_is_order:
        why, remedy = "the times of poses are their order", "Give times of the poses."
    shortfalls += [
        Shortfall(
            f"{term.candidate.name} is not written to the arm file: it is bound to "
            f"time, and {why}.",
            remedy,
        )
        for term in terms
        if term.accepted and not term.in_arm_file
    ]
    n_written = sum(term.accepted for term in terms)
    return shortfalls or Established({"n_written": n_written})


def _scaled(evidence: DiagnosisEvidence) -> Finding:
    """Look whether a length is known, here or where the arm was identified."""
    if evidence.holds_scale:
        return bad(
            "The measurements shrink the arm to a fraction of its design, whatever "
            "was found: its scale is the design's.",
            "Check arm file and campaign against each other, and measure again.",
        )
    lengths = {
        str(rival.candidate.artefact)
        for term in evidence.figures.terms
        for rival in term.alternatives
        if rival.candidate.is_length and (rival.alias or rival.candidate.is_of_several)
    }
    if lengths:
        names = " or ".join(sorted(lengths))
        return doubt(
            f"What was found may as well be the wrong length of {names}, and then the "
            "arm has another scale.",
            "Measure another certified length, or have these standards checked.",
        )
    if evidence.has_length:
        return Established()
    unknown = (
        "The scale of the arm is undetermined: no length is known in this campaign"
    )
    if evidence.was_identified:
        return doubt(
            f"{unknown}, and nothing here checks that of the arm file, which is kept. "
            "The covariance counts it as if it were a design's.",
            "Add a length standard.",
        )
    return bad(
        f"{unknown}, and the arm file is a design.",
        "Add a length standard, or diagnose an arm that was identified with one.",
    )


def _determined(evidence: DiagnosisEvidence) -> Finding:
    """Compare what is not determined with how poses kept aside are predicted."""
    predicted_mm = evidence.figures.gap.held_out_rms_mm.after or 0.0
    values = {"undetermined_mm": evidence.undetermined_mm}
    if evidence.undetermined_mm <= predicted_mm:
        return Established(values)
    return doubt(
        "Parameters of the arm are undetermined: if its design is off by a "
        f"plausible deviation there, the probe is off by "
        f"{length_mm(evidence.undetermined_mm)} where nothing was measured.",
        "Measure more and more varied postures; traverse identify names them.",
        values,
    )


def _agreeing(evidence: DiagnosisEvidence) -> Finding:
    n_all, n_excluded = evidence.n_poses, len(evidence.figures.excluded)
    values = {"n_left_out": n_excluded, "n_poses": n_all}
    if not is_many(n_excluded, n_all):
        return Established(values)
    return doubt(
        f"{n_excluded} of {counted(n_all, 'pose')} contradict the others and took "
        "no part.",
        "Find out why before the arm is used.",
        values,
    )


def _independent(evidence: DiagnosisEvidence) -> Finding:
    return no_repeats(evidence.n_repeated, evidence.n_poses)


def _in_family(evidence: DiagnosisEvidence) -> Finding:
    if not evidence.contradicted:
        return Established()
    names = ", ".join(name for name, _ in evidence.contradicted)
    file = (evidence.figures.family or {}).get("file")
    return doubt(
        f"The measurements contradict the family {file} in {names}.",
        "Look whether the arm is of that family.",
        {f"sigmas_of_{name}": sigmas for name, sigmas in evidence.contradicted},
    )


CONDITIONS: tuple[Condition[DiagnosisEvidence], ...] = (
    Condition("converged", "the adjustment converged", _converged),
    Condition("fit", "arm file and campaign belong together", _belongs),
    Condition("arm_file", "signs and zeros of the arm file fit", _file_fits),
    Condition("visible", "the poses could show effects", _visible),
    Condition("named", "whatever is missing has one name", _named),
    Condition("within_noise", "noise explains what is left", _within_noise),
    Condition("helps", "poses kept aside are predicted no worse", _helps),
    Condition("written", "everything that has a name is in the arm", _written),
    Condition("scale", "the scale of the arm is known", _scaled),
    Condition("determined", "the poses determine the arm", _determined),
    Condition("agreeing", "nearly all poses agree", _agreeing),
    Condition("repeated", "poses were measured anew", _independent),
    Condition("in_family", "the arm is like its family", _in_family),
)

"""What must be established before a diagnosis is good."""

from dataclasses import dataclass

import numpy as np

from traverse.lab.adjustment import Adjustment
from traverse.lab.diagnosis.holdout.comparison import is_beyond_noise, is_many
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.outcomes.arm_file import signs_and_zeros
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Shortfall,
    bad,
    doubt,
)
from traverse.lab.outcomes.diagnosis import DiagnosisFigures
from traverse.lab.outcomes.repeats import no_repeats
from traverse.lab.report.quantities import length_mm
from traverse.plurals import counted


@dataclass(frozen=True, slots=True)
class Judged:
    """A diagnosis, and its figures."""

    diagnosis: Diagnosis
    figures: DiagnosisFigures


def _converged(judged: Judged) -> Finding:
    if judged.diagnosis.final.adjustment.converged:
        return Established()
    return bad(
        "The estimates of the adapted arm did not converge: none of them may be used.",
        "Measure more and more varied postures; traverse identify names what moves.",
    )


def _belongs(judged: Judged) -> Finding:
    for term in judged.figures.terms:
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


def _file_fits(judged: Judged) -> Finding:
    figures = judged.figures
    return signs_and_zeros(figures.wrong_signs, figures.zero_offsets_rad)


def _visible(judged: Judged) -> Finding:
    visible = judged.figures.visible
    values = {"n_visible": visible["n"], "n_effects": visible["of"]}
    if visible["n"] > 0:
        return Established(values)
    return bad(
        "These poses could show no effect of the library.",
        "Measure more poses, in varied postures.",
        values,
    )


def _named(judged: Judged) -> Finding:
    counts = {
        f"n_{status}": sum(term.status == status for term in judged.figures.terms)
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


def _within_noise(judged: Judged) -> Finding:
    figures = judged.figures
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
    if is_beyond_noise(chi2, gap.held_out_chi2_std):
        return doubt(
            "The poses kept aside still differ from the model by "
            f"{length_mm(rms_mm)} rms, {chi2:.2g} times the mean square "
            "that noise explains: the noise is larger than was thought, or something "
            "is missing in the arm file.",
            "Measure again, where the discrepancies are largest.",
            values,
        )
    return Established(values)


def _helps(judged: Judged) -> Finding:
    figures = judged.figures
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


def _written(judged: Judged) -> Finding:
    terms = judged.figures.terms
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
    if judged.diagnosis.campaign.time_is_order:
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


def _scaled(judged: Judged) -> Finding:
    """Look whether a length is known, here or where the arm was identified."""
    if judged.diagnosis.after.network.holds_scale:
        return bad(
            "The measurements shrink the arm to a fraction of its design, whatever "
            "was found: its scale is the design's.",
            "Check arm file and campaign against each other, and measure again.",
        )
    lengths = {
        str(rival.candidate.artefact)
        for term in judged.figures.terms
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
    if judged.diagnosis.after.network.has_length():
        return Established()
    unknown = (
        "The scale of the arm is undetermined: no length is known in this campaign"
    )
    if judged.diagnosis.arm.identification is not None:
        return doubt(
            f"{unknown}, and nothing here checks that of the arm file, which is kept. "
            "The covariance counts it as if it were a design's.",
            "Add a length standard.",
        )
    return bad(
        f"{unknown}, and the arm file is a design.",
        "Add a length standard, or diagnose an arm that was identified with one.",
    )


def _undetermined_mm(adjustment: Adjustment) -> float:
    """Return how far the probe moves by undetermined directions but the scale."""
    network, split = adjustment.network, adjustment.split
    arm = adjustment.state.arm
    scale = network.undetermined_scale(arm)
    without_scale = split.undetermined - split.undetermined @ scale.T @ scale
    if not len(without_scale):
        return 0.0
    effects_mm = network.probe_effects_mm(arm, without_scale * split.tolerances)
    return float(np.linalg.norm(effects_mm))


def _determined(judged: Judged) -> Finding:
    """Compare what is not determined with how poses kept aside are predicted."""
    predicted_mm = judged.figures.gap.held_out_rms_mm.after or 0.0
    undetermined_mm = _undetermined_mm(judged.diagnosis.final.adjustment)
    values = {"undetermined_mm": undetermined_mm}
    if undetermined_mm <= predicted_mm:
        return Established(values)
    return doubt(
        "Parameters of the arm are undetermined: if its design is off by a "
        f"plausible deviation there, the probe is off by "
        f"{length_mm(undetermined_mm)} where nothing was measured.",
        "Measure more and more varied postures; traverse identify names them.",
        values,
    )


def _agreeing(judged: Judged) -> Finding:
    n_all = len(judged.diagnosis.campaign.poses)
    n_excluded = len(judged.figures.excluded)
    values = {"n_left_out": n_excluded, "n_poses": n_all}
    if not is_many(n_excluded, n_all):
        return Established(values)
    return doubt(
        f"{n_excluded} of {counted(n_all, 'pose')} contradict the others and took "
        "no part.",
        "Find out why before the arm is used.",
        values,
    )


def _independent(judged: Judged) -> Finding:
    poses = judged.diagnosis.campaign.poses
    return no_repeats(poses.n_repeated, len(poses))


def _in_family(judged: Judged) -> Finding:
    prior = judged.diagnosis.campaign.prior
    if prior is None or not prior.contradicted:
        return Established()
    names = ", ".join(name for name, _ in prior.contradicted)
    return doubt(
        f"The measurements contradict the family {prior.family} in {names}.",
        "Look whether the arm is of that family.",
        {f"sigmas_of_{name}": sigmas for name, sigmas in prior.contradicted},
    )


CONDITIONS: tuple[Condition[Judged], ...] = (
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

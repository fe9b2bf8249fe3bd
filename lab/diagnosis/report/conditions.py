"""What must be established before a diagnosis is good."""

from dataclasses import replace

import numpy as np

from traverse.lab.adjustment import Adjustment
from traverse.lab.diagnosis.holdout.comparison import is_noise
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Shortfall,
    bad,
    doubt,
)
from traverse.lab.outcomes.common_conditions import (
    few_excluded,
    like_design,
    like_family,
    no_repeats,
    several_reaches,
    signs_and_zeros,
)
from traverse.lab.report.quantities import length_mm


def _converged(diagnosis: Diagnosis) -> Finding:
    if diagnosis.final.adjustment.converged:
        return Established()
    return bad(
        "The estimates of the adapted arm did not converge: none of them may be used.",
        "Measure more and more varied postures; traverse identify names what moves.",
    )


def _belongs(diagnosis: Diagnosis) -> Finding:
    for term in diagnosis.terms:
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


def _file_fits(diagnosis: Diagnosis) -> Finding:
    return signs_and_zeros(diagnosis.wrong_signs, diagnosis.zero_offsets_rad)


def _like_design(diagnosis: Diagnosis) -> Finding:
    adjustment = diagnosis.final.adjustment
    estimated = adjustment.state.arm
    changes = adjustment.changes(replace(estimated, geometry=diagnosis.design))
    names = adjustment.network.parameters.free_names
    return like_design(dict(zip(names, changes.tolist(), strict=True)))


def _several_reaches(diagnosis: Diagnosis) -> Finding:
    geometry = diagnosis.final.adjustment.state.arm.geometry
    return several_reaches(geometry, diagnosis.campaign.poses.angles_rad)


def _visible(diagnosis: Diagnosis) -> Finding:
    values = {"n_visible": diagnosis.n_visible, "n_effects": diagnosis.n_library}
    if not diagnosis.blind:
        return Established(values)
    return bad(
        "These poses could show no effect of the library.",
        "Measure more poses, in varied postures.",
        values,
    )


def _named(diagnosis: Diagnosis) -> Finding:
    counts = {
        f"n_{status}": sum(term.status == status for term in diagnosis.terms)
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


def _within_noise(diagnosis: Diagnosis) -> Finding:
    exceeded = diagnosis.exceeded
    last = diagnosis.gap.after.without_blunders or diagnosis.gap.after
    values = {"held_out_chi2": last.chi2, "held_out_rms_mm": last.rms_mm}
    if exceeded is not None:
        beyond = (
            f"What is left is {exceeded:.3g} times the mean square that the "
            "stated noise explains"
        )
        if diagnosis.verdict != "unexplained":
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
    if last.n == 0:
        return doubt(
            "No pose could be kept aside, so that nothing proves the result.",
            "Measure more poses.",
        )
    if not is_noise(last):
        return doubt(
            "The poses kept aside still differ from the model by "
            f"{length_mm(last.rms_mm)} rms, {last.chi2:.2g} times the mean square "
            "that noise explains: the noise is larger than was thought, or something "
            "is missing in the arm file.",
            "Measure again, where the discrepancies are largest.",
            values,
        )
    return Established(values)


def _helps(diagnosis: Diagnosis) -> Finding:
    ledger = diagnosis.ledger
    values = {
        "held_out_chi2_before": ledger[0].held_out_chi2,
        "held_out_chi2_after": ledger[-1].held_out_chi2,
    }
    if diagnosis.vetoed:
        return bad(
            "The poses kept aside are predicted worse with what was found than "
            "without: nothing was added to the arm.",
            "Measure again, or more.",
            values,
        )
    if diagnosis.is_identified_anew:
        return doubt(
            "The arm as identified, without what was found, predicts the poses "
            "kept aside better than the one with it, and is what is written.",
            "Measure again, or more.",
            values,
        )
    return Established(values)


def _written(diagnosis: Diagnosis) -> Finding:
    terms = diagnosis.terms
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
    if diagnosis.campaign.time_is_order:
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


def _scaled(diagnosis: Diagnosis) -> Finding:
    """Look whether a length is known, here or where the arm was identified."""
    if diagnosis.after.network.holds_scale:
        return bad(
            "The measurements shrink the arm to a fraction of its design, whatever "
            "was found: its scale is the design's.",
            "Check arm file and campaign against each other, and measure again.",
        )
    lengths = {
        str(rival.candidate.artefact)
        for term in diagnosis.terms
        for rival in term.alternatives
        if rival.changes_scale
    }
    if lengths:
        names = " or ".join(sorted(lengths))
        return doubt(
            f"What was found may as well be the wrong length of {names}, and then the "
            f"arm is {1e6 * diagnosis.other_scale:.0f} ppm larger or smaller; its "
            "covariance counts that.",
            "Measure another certified length, or have these standards checked.",
            {"other_scale_ppm": 1e6 * diagnosis.other_scale},
        )
    if diagnosis.after.network.has_length():
        return Established()
    unknown = (
        "The scale of the arm is undetermined: no length is known in this campaign"
    )
    if diagnosis.arm.identification is not None:
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


def _determined(diagnosis: Diagnosis) -> Finding:
    """Compare what is not determined with how poses kept aside are predicted."""
    last = diagnosis.gap.after
    predicted_mm = last.rms_mm if last.n else 0.0
    undetermined_mm = _undetermined_mm(diagnosis.final.adjustment)
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


def _agreeing(diagnosis: Diagnosis) -> Finding:
    n_excluded = int(np.count_nonzero(diagnosis.excluded | diagnosis.left_out))
    return few_excluded(n_excluded, len(diagnosis.campaign.poses))


def _independent(diagnosis: Diagnosis) -> Finding:
    poses = diagnosis.campaign.poses
    return no_repeats(poses.n_repeated, len(poses))


def _in_family(diagnosis: Diagnosis) -> Finding:
    prior = diagnosis.campaign.prior
    if prior is None:
        return Established()
    return like_family(prior.family, prior.contradicted, is_of_it=bool(prior.names))


CONDITIONS: tuple[Condition[Diagnosis], ...] = (
    Condition("converged", "the adjustment converged", _converged),
    Condition("fit", "arm file and campaign belong together", _belongs),
    Condition("arm_file", "signs and zeros of the arm file fit", _file_fits),
    Condition("design", "no parameter is far from the design", _like_design),
    Condition("visible", "the poses could show effects", _visible),
    Condition("named", "whatever is missing has one name", _named),
    Condition("within_noise", "noise explains what is left", _within_noise),
    Condition("helps", "poses kept aside are predicted no worse", _helps),
    Condition("written", "everything that has a name is in the arm", _written),
    Condition("scale", "the scale of the arm is known", _scaled),
    Condition("determined", "the poses determine the arm", _determined),
    Condition("agreeing", "nearly all poses agree", _agreeing),
    Condition("repeated", "poses were measured anew", _independent),
    Condition("reach", "poses are at several reaches", _several_reaches),
    Condition("in_family", "the arm is like its family", _in_family),
)

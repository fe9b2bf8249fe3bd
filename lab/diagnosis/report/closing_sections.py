"""The sections of the page about what was not found, what was left out, and how."""

from traverse.lab.diagnosis.model.candidate import BankName
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.detectable_table import (
    joint_rows,
    reasons,
    whole_arm_rows,
)
from traverse.lab.diagnosis.report.names import candidate_label, quantity
from traverse.lab.diagnosis.report.plots import Plots
from traverse.lab.diagnosis.report.words import excluded_sentence, noise_sentences
from traverse.lab.report.html import note, paragraph, section, table

_MOST_EXCLUDED = 200
_BANKS = {
    BankName.LIBRARY: "named effects",
    BankName.STEPS: "jumps at any moment",
    BankName.GENERIC: "curves over any covariate",
    BankName.HARMONIC: "harmonics of every joint",
    BankName.TRANSMISSION: "waves of any cycles a turn",
}


def leftover_section(diagnosis: Diagnosis) -> str:
    """Show what remains in every bank."""
    rows = [
        [
            _BANKS[left.bank],
            candidate_label(left.candidate),
            f"{left.log10_p:.1f}",
            f"{left.threshold_log10_p:.1f}",
        ]
        for left in diagnosis.leftovers
    ]
    return section(
        "leftovers",
        "What remains",
        table(["bank", "largest finding", "log10 p", "needed"], rows, texts=2),
        note(
            "The most significant candidate of each bank in the final model. It would "
            "have been believed from the needed p-value on, which chance reaches "
            "seldom however many candidates are looked at."
        ),
    )


def detectable_section(diagnosis: Diagnosis) -> str:
    """Show what would have been seen."""
    found = diagnosis.detectable
    if not found:
        return section(
            "detectable", "What would have been seen", paragraph("Not worked out.")
        )
    names = diagnosis.campaign.joint_names
    whys = [paragraph(f"Cannot be seen. {why}.") for why in reasons(found)]
    head = ["effect of the whole arm", "seen from", "rms at the probe"]
    return section(
        "detectable",
        "What would have been seen",
        table(["effect", *names], joint_rows(found, names)),
        table(head, whole_arm_rows(found)),
        note(
            "The smallest size that is found with a probability of 95 %, in the worst "
            "phase or direction. Dash: cannot be seen at all, for the reason given."
        ),
        *whys,
    )


def excluded_section(diagnosis: Diagnosis, plots: Plots) -> str:
    """List the poses that were left out."""
    sentence = paragraph(excluded_sentence(diagnosis))
    poses, campaign = diagnosis.campaign.poses, diagnosis.campaign
    left_out = diagnosis.excluded | plots.contradicting
    places = [int(at) for at in left_out.nonzero()[0]]
    if not places:
        return section("excluded", "Excluded poses", sentence)
    rows = []
    for at in places[:_MOST_EXCLUDED]:
        artefact = int(poses.artefacts[at])
        rows.append(
            [
                campaign.artefacts[artefact].id,
                campaign.feature_names[artefact][int(poses.features[at])],
                "kept aside" if diagnosis.held_out[at] else "",
                str(int(poses.lines[at])),
                f"{poses.time_s[at]:.1f}",
                f"{plots.after.sizes[at]:.1f}",
            ]
        )
    head = ["artefact", "feature", "", "line", "time [s]", "misclosure [sigma]"]
    more = len(places) - len(rows)
    return section(
        "excluded",
        "Excluded poses",
        sentence,
        table(head, rows, texts=3),
        *([paragraph(f"And {more} more, in discrepancies.csv.")] if more else []),
        note(
            "Line: of the table of poses, its header being line 1. All poses were "
            "tried again after every term: a missing effect can look like a blunder. "
            "Poses kept aside that contradict the final model count neither before "
            "nor after."
        ),
    )


def method_section(diagnosis: Diagnosis) -> str:
    """Say how everything was computed."""
    noise = diagnosis.noise
    campaign = diagnosis.campaign
    encoders = [
        [name, quantity(std, None, "rad")]
        for name, std in zip(campaign.joint_names, noise.encoder_rad, strict=True)
    ]
    contacts = [
        [artefact.id, quantity(std, None, "mm")]
        for artefact, std in zip(campaign.artefacts, noise.contact_mm, strict=True)
    ]
    seconds = ", ".join(
        f"{stage} {seconds:.2f} s" for stage, seconds in diagnosis.seconds.items()
    )
    return section(
        "method",
        "Noise, and how it was computed",
        *(paragraph(sentence) for sentence in noise_sentences(diagnosis)),
        table(["reading of", "std"], encoders),
        table(["contact with", "std"], contacts),
        paragraph(
            f"Seed {diagnosis.seed} (of the split and of the thresholds): the same "
            "seed gives the same result."
        ),
        *([paragraph(f"Time: {seconds}.")] if seconds else []),
    )

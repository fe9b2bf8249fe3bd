"""The sections of the page of a diagnosis."""

from html import escape

from lab.diagnosis.candidate import BankName
from lab.diagnosis.diagnosis import Diagnosis, Term
from lab.diagnosis.report.detectable_table import (
    joint_rows,
    reasons,
    whole_arm_rows,
)
from lab.diagnosis.report.names import (
    name_in_words,
    odds,
    p_in_words,
    quantity,
    size_in_words,
)
from lab.diagnosis.report.pictures import term_caption
from lab.diagnosis.report.plots import Plots
from lab.diagnosis.report.words import (
    excluded_sentence,
    held_out_sentence,
    noise_sentences,
    rival_sentences,
)
from lab.identification.report.markup import image, note, paragraph, section, table

_MOST_EXCLUDED = 200
_BANKS = {
    BankName.LIBRARY: "named effects",
    BankName.STEPS: "jumps at any moment",
    BankName.GENERIC: "curves over any covariate",
    BankName.HARMONIC: "harmonics of every joint",
}


def ledger_section(diagnosis: Diagnosis, plots: Plots) -> str:
    """Show how the gap shrank."""
    head = [
        "model",
        "held-out rms [mm]",
        "held-out misfit",
        "mean distance [mm]",
        "sigma0",
    ]
    rows = [
        [
            "nothing added" if step.effect is None else f"+ {step.effect}",
            f"{step.held_out.rms_mm:.5f}",
            f"{step.held_out.chi2:.3f}",
            ""
            if step.held_out.mean_distance_mm is None
            else f"{step.held_out.mean_distance_mm:.5f}",
            f"{step.sigma0:.3f}",
        ]
        for step in diagnosis.ledger
    ]
    return section(
        "ledger",
        "The gap, term by term",
        paragraph(held_out_sentence(diagnosis)),
        image(plots.ledger, "held-out discrepancy after every term"),
        table(head, rows),
        note(
            "About a third of each artefact's poses was put aside before anything was "
            "looked at; no choice and no estimate knows them. Misfit: their mean "
            "square in units of what noise and the uncertainty of the model lead to "
            "expect; 1 is noise alone. sigma0: of the poses used for choosing."
        ),
    )


def term_section(diagnosis: Diagnosis, plots: Plots) -> str:
    """Show every term with its evidence and its rivals."""
    if not diagnosis.terms:
        return section("terms", "What is missing", paragraph("Nothing was found."))
    parts = []
    for number, (term, png) in enumerate(
        zip(diagnosis.terms, plots.terms, strict=True), start=1
    ):
        parts.append(f"<h3>{number}. {escape(name_in_words(term.candidate))}</h3>")
        parts.append(paragraph(_evidence(term)))
        parts += [paragraph(sentence) for sentence in rival_sentences(term)]
        if png is not None:
            parts.append(image(png, term_caption(diagnosis, number - 1)))
        else:
            parts.append(
                paragraph("It moves no pose; see the artefacts for what it does.")
            )
        parts.append(_estimates(term))
        if term.alternatives:
            parts.append(_rivals(term))
        if term.separate_by:
            parts.append(paragraph(f"To separate: {term.separate_by}"))
    parts.append(
        note(
            "Left: the discrepancy of all poses before and after; dots are poses, "
            "symbols are means of parts of the range with two standard errors. What "
            "the geometry could take up is gone from it. Right: the term as it was "
            "estimated, and the same data with only this term taken out of the model."
        )
    )
    return section("terms", "What is missing", *parts)


def _evidence(term: Term) -> str:
    size = size_in_words(term)
    said = f"Status: {term.status}. " + (f"Size: {size}. " if size else "")
    against = odds(term.log_bayes_factor)
    return (
        f"{said}Evidence against nothing missing {against} "
        f"({p_in_words(term.log10_p)} beside all other terms)."
    )


def _estimates(term: Term) -> str:
    rows = []
    for key, found in term.estimates.items():
        if isinstance(found.value, tuple) and isinstance(found.std, tuple):
            parts = zip(found.value, found.std, strict=True)
            rows += [
                [f"{key} [{at}]", f"{value:.4g}", f"{std:.2g}", found.unit]
                for at, (value, std) in enumerate(parts)
            ]
        else:
            rows.append([key, f"{found.value:.5g}", f"{found.std:.2g}", found.unit])
    return table(["key of the arm file", "value", "std", "unit"], rows)


def _rivals(term: Term) -> str:
    rows = [
        [
            name_in_words(one.candidate),
            "structural alias" if one.alias else "cannot be excluded",
            odds(term.log_bayes_factor - one.log_bayes_factor),
            f"{one.correlation:.4f}",
        ]
        for one in term.alternatives
    ]
    return table(["rival", "", "evidence", "correlation"], rows, texts=2)


def map_section(plots: Plots) -> str:
    """Show where the discrepancy lives, before and after."""
    return section(
        "maps",
        "Where the discrepancy lives",
        image(plots.artefacts, "misclosures of every artefact before and after"),
        image(plots.joints, "discrepancy over every joint's angle"),
        image(plots.conditions, "discrepancy over time and other conditions"),
        note(
            "Measured against simulated; the geometry is estimated in both. Middle: "
            "by how much each reading is larger than the simulation's, if that joint "
            "were the only cause, as means of parts of the range with two standard "
            "errors: what belongs to one joint shows at others too, but weaker. "
            "Below: root mean square in standard deviations of noise. All poses are "
            "shown but those left out; single poses stand in discrepancies.csv."
        ),
    )


def leftover_section(diagnosis: Diagnosis) -> str:
    """Show what remains in every bank."""
    rows = [
        [
            _BANKS[left.bank],
            name_in_words(left.candidate),
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
    places = [int(at) for at in diagnosis.excluded.nonzero()[0]]
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
            "tried again after every term: a missing effect can look like a blunder."
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

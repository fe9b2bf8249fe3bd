"""The sections of the page about what was found."""

from html import escape

from traverse.lab.diagnosis.model.result import Diagnosis, Term
from traverse.lab.diagnosis.report.names import (
    candidate_label,
    odds,
    p_value_text,
    step_names,
    term_size_text,
)
from traverse.lab.diagnosis.report.pictures import term_caption
from traverse.lab.diagnosis.report.plots import Plots
from traverse.lab.diagnosis.report.words import (
    cluster_sentence,
    held_out_sentence,
    rival_sentences,
)
from traverse.lab.report.html import (
    image,
    note,
    paragraph,
    section,
    table,
)


def ledger_section(diagnosis: Diagnosis, plots: Plots) -> str:
    """Show how the gap shrank."""
    head = ["model", "held-out rms [mm]", "held-out misfit", "sigma0"]
    distances = [step.held_out.mean_distance_mm for step in diagnosis.ledger]
    has_points = None not in distances
    if has_points:
        head.append("mean distance [mm]")
    rows = [
        [
            name,
            f"{step.held_out.rms_mm:.5f}",
            f"{step.held_out.chi2:.3f}",
            f"{step.sigma0:.3f}",
            *([f"{step.held_out.mean_distance_mm:.5f}"] if has_points else []),
        ]
        for name, step in zip(step_names(diagnosis), diagnosis.ledger, strict=True)
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
        parts.append(f"<h3>{number}. {escape(candidate_label(term.candidate))}</h3>")
        parts.append(paragraph(_evidence(term)))
        parts += [paragraph(sentence) for sentence in rival_sentences(term)]
        if png is not None:
            parts.append(image(png, term_caption(diagnosis, number - 1)))
        else:
            parts.append(paragraph(_why_no_picture(term)))
        if term.estimates:
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


def _why_no_picture(term: Term) -> str:
    if term.cluster is not None:
        return cluster_sentence(term.cluster)
    if term.effect is None:
        return "The arm file has no form for such a curve: it was not added."
    return "It moves no pose; see the artefacts for what it does."


def _evidence(term: Term) -> str:
    size = term_size_text(term)
    said = f"Status: {term.status}. " + (f"Size: {size}. " if size else "")
    against = odds(term.log_bayes_factor)
    return (
        f"{said}Evidence against nothing missing {against} "
        f"({p_value_text(term.log10_p)} beside all other terms)."
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
            candidate_label(one.candidate),
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
            "shown but the excluded ones; each stands in discrepancies.csv."
        ),
    )

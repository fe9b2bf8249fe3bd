"""The page: everything about a diagnosis in one file without references."""

import numpy as np

from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.closing_sections import (
    detectable_section,
    excluded_section,
    leftover_section,
    method_section,
)
from traverse.lab.diagnosis.report.plots import Plots
from traverse.lab.diagnosis.report.sections import (
    ledger_section,
    map_section,
    term_section,
)
from traverse.lab.diagnosis.report.words import verdict_sentences
from traverse.lab.report.html import note, paragraph, section
from traverse.lab.report.page_frame import framed, navigation

_STYLE = """
h3 { font-size: 1rem; margin: 1.6rem 0 0; }
.verdict.open { border-color: #D55E00; background: #fdf3ec; }
.verdict p:first-child { font-weight: 600; }
"""
_CONTENTS = {
    "ledger": "the gap",
    "terms": "what is missing",
    "maps": "where it lives",
    "leftovers": "what remains",
    "detectable": "what would have been seen",
    "excluded": "excluded",
    "method": "noise and method",
}


def report_page(diagnosis: Diagnosis, plots: Plots) -> str:
    """Make the page; the text is complete in itself."""
    parts = [
        note(_provenance(diagnosis)),
        navigation(_CONTENTS),
        _verdict(diagnosis),
        ledger_section(diagnosis, plots),
        term_section(diagnosis, plots),
        map_section(plots),
        leftover_section(diagnosis),
        detectable_section(diagnosis),
        excluded_section(diagnosis, plots),
        method_section(diagnosis),
    ]
    return framed(f"Diagnosis of {diagnosis.arm.name}", parts, _STYLE)


def _provenance(diagnosis: Diagnosis) -> str:
    campaign = diagnosis.campaign
    started = (
        "" if campaign.start_utc is None else f", begun {campaign.start_utc:%F %T}"
    )
    digest = f", SHA-256 {campaign.digest[:12]}" if campaign.digest else ""
    choosing = int(np.count_nonzero(diagnosis.choosing))
    held_out = int(np.count_nonzero(diagnosis.held_out))
    return (
        f"Campaign of {len(campaign.poses)} poses at {len(campaign.artefacts)} "
        f"artefacts{started}{digest}; {choosing} poses for choosing, {held_out} kept "
        f"aside; seed {diagnosis.seed}."
    )


def _verdict(diagnosis: Diagnosis) -> str:
    settled = diagnosis.verdict in ("clean", "named") and not diagnosis.vetoed
    kind = "verdict" if settled else "verdict open"
    text = "\n".join(paragraph(one) for one in verdict_sentences(diagnosis))
    heading = f"Verdict: {diagnosis.verdict}"
    return section("verdict", heading, f'<div class="{kind}">{text}</div>')

"""The page: everything about a diagnosis in one file without references."""

from html import escape

import numpy as np

from lab.diagnosis.diagnosis import Diagnosis
from lab.diagnosis.report.closing_sections import (
    detectable_section,
    excluded_section,
    leftover_section,
    method_section,
)
from lab.diagnosis.report.plots import Plots
from lab.diagnosis.report.sections import ledger_section, map_section, term_section
from lab.diagnosis.report.words import verdict_sentences
from lab.identification.report.markup import note, paragraph, section

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0; } h3 { font-size: 1rem; margin: 1.6rem 0 0; }
h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #ccc; }
.verdict { border-left: .4rem solid #0072B2; padding: .2rem 1rem; background: #f4f7fa; }
.verdict.open { border-color: #D55E00; background: #fdf3ec; }
.verdict p:first-child { font-weight: 600; }
.note { color: #555; font-size: .85rem; }
figure { margin: 1rem 0; } img { max-width: 100%; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .85rem; margin: .8rem 0; }
th, td { padding: .18rem .8rem .18rem 0; text-align: left; vertical-align: top;
         border-bottom: 1px solid #e4e4e4; }
th { border-bottom: 1px solid #777; }
.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.number { white-space: normal; }
nav a { margin-right: 1rem; white-space: nowrap; font-size: .85rem; }
@media print { nav { display: none; } section { break-inside: avoid-page; } }
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
    title = f"Diagnosis of {diagnosis.arm.name}"
    links = "".join(f'<a href="#{name}">{text}</a>' for name, text in _CONTENTS.items())
    parts = [
        f"<h1>{escape(title)}</h1>",
        note(_provenance(diagnosis)),
        f"<nav>{links}</nav>",
        _verdict(diagnosis),
        ledger_section(diagnosis, plots),
        term_section(diagnosis, plots),
        map_section(plots),
        leftover_section(diagnosis),
        detectable_section(diagnosis),
        excluded_section(diagnosis, plots),
        method_section(diagnosis),
    ]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )


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

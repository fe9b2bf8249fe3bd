"""The certificate as a page: everything in one file, raw data attached."""

import base64
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.acceptance.certificate.words import (
    UNCERTAINTY,
    VERDICTS,
    budget_text,
    conclusion,
    is_signed,
    mm,
    source_text,
)
from traverse.lab.report.figures import picture
from traverse.lab.report.html import (
    image,
    note,
    paragraph,
    section,
    table,
)
from traverse.lab.report.page_frame import framed

_WIDTH_MM = 165.0
_STYLE = """
h3 { font-size: 1rem; margin-bottom: 0; } h3 + p { margin-top: .2rem; }
code { font-size: .75rem; }
#data p { overflow-wrap: anywhere; font-size: .8rem; }
"""


def certificate_page(certificate: SealedCertificate) -> str:
    """Make the page; the text is complete in itself."""
    values = certificate.values
    title = f"{values['title']}: {values['arm']['name']}"
    good = values["complete"] and values["verdict"] in (None, "accept")
    kind = "verdict" if good else "verdict bad"
    parts = [
        note(f"Computed {values['date_utc']}; arm file {values['arm']['digest'][:16]}"),
        f'<div class="{kind}">{paragraph(conclusion(values))}</div>',
        _figures(values),
        _missing(values),
        _definitions(values),
        *_pictures(values),
        _data(certificate, values),
    ]
    return framed(title, parts, _STYLE)


def _figures(values: Mapping[str, Any]) -> str:
    factor = values["decision"]["coverage_factor"]
    head = [
        "figure",
        "decision",
        "value [mm]",
        f"U, k = {factor:g} [mm]",
        "limit [mm]",
        "guard band [mm]",
    ]
    rows = [
        [
            figure["name"],
            VERDICTS[figure["verdict"]],
            mm(figure["value_mm"], signed=is_signed(figure)),
            mm(figure["expanded_uncertainty_mm"]),
            "" if figure["limit_mm"] is None else mm(figure["limit_mm"]),
            "" if figure["guard_mm"] is None else mm(figure["guard_mm"]),
        ]
        for figure in values["figures"]
    ]
    rule = next((f["rule"] for f in values["figures"] if f["rule"]), None)
    return section(
        "figures",
        "Figures",
        table(head, rows, texts=2),
        note(UNCERTAINTY + ("" if rule is None else f" Decisions: {rule}.")),
        *(note(f"{f['name']}: {r}.") for f in values["figures"] for r in f["remarks"]),
        *(note(f"{remark}.") for remark in values["remarks"]),
    )


def _missing(values: Mapping[str, Any]) -> str:
    if not values["missing"]:
        return ""
    rows = [
        [entry["name"], what] for entry in values["missing"] for what in entry["what"]
    ]
    head = ["not computed", "because"]
    return section("missing", "Missing", table(head, rows, texts=2))


def _definitions(values: Mapping[str, Any]) -> str:
    parts = []
    for figure in values["figures"]:
        parts.append(f"<h3>{escape(figure['name'])}</h3>")
        source = f" Source of the definition: {source_text(figure)}."
        parts.append(paragraph(f"{values['title']}: {figure['definition']}.{source}"))
        parts.append(note(f"Uncertainty: {budget_text(figure)}."))
        if figure["parts"]:
            rows = [[part["name"], mm(part["value_mm"])] for part in figure["parts"]]
            parts.append(table(["part", "mm"], rows))
    return section("definitions", "Definitions and parts", *parts)


def _pictures(values: Mapping[str, Any]) -> Iterator[str]:
    for title, height_mm, paint in paintings(values):
        png = picture(_WIDTH_MM, height_mm, paint)
        name = title.lower().replace(" ", "-")
        yield section(name, title, image(png, title))


def _data(certificate: SealedCertificate, values: Mapping[str, Any]) -> str:
    digest = values["digest"]
    rows = "".join(
        f'<tr><td><a download="{escape(name)}" href="data:application/octet-stream;'
        f'base64,{base64.b64encode(content).decode("ascii")}">{escape(name)}</a></td>'
        f"<td>{len(content)}</td><td><code>{digest['files'][name]}</code></td></tr>"
        for name, content in sorted(certificate.files.items())
    )
    return section(
        "data",
        "Raw data and digests",
        '<div class="wide"><table><thead><tr><th>file</th><th>bytes</th>'
        f"<th>{escape(digest['algorithm'])}</th></tr></thead><tbody>{rows}</tbody>"
        "</table></div>",
        paragraph(f"Result: {digest['result']}"),
        paragraph(f"Over all: {digest['digest']}"),
        note(
            "The digest over all ties figures, raw data, arm file and limits together: "
            "`traverse verify --check` computes it again from certificate.json and the "
            "folder data, and the figures from the data. It is no signature of a "
            "person: keep it, or have it signed, where nobody can change it."
        ),
    )

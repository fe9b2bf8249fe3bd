"""Figures in words: lines for a terminal, cells for a page."""

from collections.abc import Iterator, Mapping
from typing import Any

VERDICTS = {
    "accept": "accepted",
    "reject": "rejected",
    "neither": "neither accepted nor rejected",
    None: "no limit given",
}
UNCERTAINTY = (
    "The uncertainty is that of the test: the standard's certificate, temperature, "
    "expansion, form and fixture. The arm's own errors, its repeatability among them, "
    "are what is tested and are no part of it."
)


def mm(value: float, *, signed: bool = False) -> str:
    """Write a length to a tenth of a micrometre."""
    return f"{value:+.4f}" if signed else f"{value:.4f}"


def is_signed(figure: Mapping[str, Any]) -> bool:
    """Say whether a figure has a sign."""
    return figure["key"] in (
        "p_size",
        "e_uni",
        "e_bi",
        "volumetric_max",
        "interim_length",
    )


def figure_lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Say a certificate in lines.

    Args:
        values: The certificate.
    """
    factor = values["decision"]["coverage_factor"]
    yield f"{values['title']}: arm {values['arm']['name']}, {values['date_utc']}"
    for figure in values["figures"]:
        value = mm(figure["value_mm"], signed=is_signed(figure))
        expanded = mm(figure["expanded_uncertainty_mm"])
        line = f"{figure['name']}: {value} mm, U = {expanded} mm (k = {factor:g})"
        if figure["limit_mm"] is not None:
            line += f", MPE {mm(figure['limit_mm'])} mm"
        yield f"{line}: {VERDICTS[figure['verdict']]}"
        yield f"  {figure['definition']}"
        yield f"  source of the definition: {source_text(figure)}"
        if figure["rule"]:
            yield f"  {figure['rule']} = {mm(figure['guard_mm'])} mm"
        yield f"  budget: {budget_text(figure)}"
        for remark in figure["remarks"]:
            yield f"  note: {remark}"
    for missing in values["missing"]:
        yield f"{missing['name']}: not computed"
        for what in missing["what"]:
            yield f"  {what}"
    for remark in values["remarks"]:
        yield f"note: {remark}"
    yield conclusion(values)


def source_text(figure: Mapping[str, Any]) -> str:
    """Say where a definition comes from, and what to do about it."""
    if figure["confirm"]:
        return f"{figure['source']}; {figure['confirm']}"
    return "published descriptions of the standard"


def budget_text(figure: Mapping[str, Any]) -> str:
    """Say the lines of a budget that are not zero."""
    lines = [
        f"{line['name']} {line['standard_mm']:.5f} mm ({line['formula']})"
        for line in figure["budget"]
        if line["standard_mm"] > 0.0
    ]
    return "; ".join(lines) or "nothing stated, so 0"


def conclusion(values: Mapping[str, Any]) -> str:
    """Say what it comes to, in a sentence."""
    if values["missing"]:
        names = ", ".join(missing["name"] for missing in values["missing"])
        return f"Incomplete: {names} not computed."
    verdict = values["verdict"]
    if verdict is None:
        return "Complete; no limits given, so nothing is decided."
    undecided = [f["name"] for f in values["figures"] if f["verdict"] is None]
    rest = f" Without a limit: {', '.join(undecided)}." if undecided else ""
    return f"Complete: {VERDICTS[verdict]}.{rest}"

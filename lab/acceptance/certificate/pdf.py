"""The certificate on paper: A4 pages by matplotlib."""

import io
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from traverse.lab.acceptance.certificate.page import WORDS, figure_lines
from traverse.lab.acceptance.certificate.pictures import paintings

_INCHES_PER_MM = 1.0 / 25.4
_A4_MM = (210.0, 297.0)
_MARGIN_MM, _LINE_MM = 18.0, 4.1
_COLUMNS = 104
_FONT = {"font.family": "DejaVu Sans", "font.size": 8.0, "pdf.fonttype": 42}


def certificate_pdf(values: Mapping[str, Any]) -> bytes:
    """Make the document.

    Args:
        values: The certificate.
    """
    file = io.BytesIO()
    with mpl.rc_context(_FONT), PdfPages(file) as pages:  # type: ignore[arg-type] # the stubs want literal keys
        for number, lines in enumerate(_text_pages(values), 1):
            pages.savefig(_text_page(lines, number))
        for title, height_mm, paint in paintings(values):
            figure = Figure(
                figsize=(
                    _A4_MM[0] * _INCHES_PER_MM,
                    (height_mm + 25.0) * _INCHES_PER_MM,
                ),
                layout="constrained",
            )
            figure.suptitle(title)
            paint(figure)
            pages.savefig(figure)
        document = pages.infodict()
        document["Title"] = f"{values['title']}: {values['arm']['name']}"
        document["Subject"] = f"SHA-256 {values['digest']['digest']}"
    return file.getvalue()


def _text_pages(values: Mapping[str, Any]) -> Iterator[list[str]]:
    title, *rest = figure_lines(values)
    lines = [
        title,
        "",
        *rest,
        "",
        WORDS.uncertainty(),
        "",
        f"Arm file: {values['arm']['digest']}",
        *(f"{name}: {digest}" for name, digest in values["digest"]["files"].items()),
        f"Result: {values['digest']['result']}",
        f"Over all ({values['digest']['algorithm']}): {values['digest']['digest']}",
    ]
    wrapped: list[str] = []
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()))
        wrapped += textwrap.wrap(
            line, _COLUMNS, subsequent_indent=indent, break_long_words=True
        ) or [""]
    per_page = int((_A4_MM[1] - 2.0 * _MARGIN_MM) / _LINE_MM)
    for first in range(0, len(wrapped), per_page):
        yield wrapped[first : first + per_page]


def _text_page(lines: list[str], number: int) -> Figure:
    figure = Figure(figsize=(_A4_MM[0] * _INCHES_PER_MM, _A4_MM[1] * _INCHES_PER_MM))
    left = _MARGIN_MM / _A4_MM[0]
    for row, line in enumerate(lines):
        up = 1.0 - (_MARGIN_MM + row * _LINE_MM) / _A4_MM[1]
        is_title = number == 1 and row == 0
        figure.text(
            left,
            up,
            line.replace("$", r"\$"),
            va="top",
            fontweight="bold" if is_title or " mm, U = " in line else "normal",
            fontsize=11 if is_title else 8,
        )
    figure.text(0.5, 0.03, str(number), ha="center", fontsize=7)
    return figure

"""The certificate on paper: typeset A4 pages, with its data attached."""

import io
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, cast

from fpdf import FPDF
from fpdf.enums import TableBordersLayout
from fpdf.fonts import FontFace, TTFFont
from matplotlib.font_manager import FontProperties, findfont

from traverse.lab.acceptance.certificate.page import (
    BUDGET_COLUMNS,
    COMPARISON_COLUMNS,
    STANDARD_COLUMNS,
    WIDTH_MM,
    WORDS,
    administration_rows,
    budget_cells,
    comparison_cells,
    correlation_table,
    figure_cells,
    missing_rows,
    standard_cells,
)
from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.report.figures import STATE_COLOURS, picture

_MARGIN_MM = 20.0
_LINE_MM = 4.6
_NOTE_LINE_MM = 3.9
_TEXT_PT, _NOTE_PT, _HEADING_PT, _TITLE_PT = 9.0, 7.5, 11.5, 17.0
_BLACK, _GREY, _RULE = (20, 20, 20), (95, 95, 95), (200, 200, 200)
_SHADE = (242, 242, 242)
_SIGNATURE_MM = 20.0


class _Document(FPDF):
    """A page's header and footer, and the few kinds of blocks of a certificate."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__(format="A4")
        self._values = values
        self.set_margins(_MARGIN_MM, _MARGIN_MM)
        self.set_auto_page_break(True, margin=_MARGIN_MM)
        for style, weight in (("", "normal"), ("B", "bold")):
            file = findfont(FontProperties(family="DejaVu Sans", weight=weight))
            self.add_font("sans", style, file)
        self.set_draw_color(*_RULE)
        self.set_title(f"{values['title']}: {values['arm']['name']}")
        self.set_subject(f"SHA-256 {values['digest']['digest']}")
        self.set_creation_date(datetime.fromisoformat(values["date_utc"]))
        self.add_page()

    def normalize_text(self, text: str) -> str:
        """Escape what does not print or has no glyph: no part of a name vanishes."""
        font = self.current_font
        known = font.cmap if isinstance(font, TTFFont) else {}
        return "".join(
            c
            if c == "\n" or (c.isprintable() and ord(c) in known)
            else c.encode("unicode_escape").decode()
            for c in text
        )

    def header(self) -> None:
        self._font(_NOTE_PT, colour=_GREY)
        self.set_y(10.0)
        self.cell(0, 5, f"Verification by {self._values['title']}")
        self.set_x(_MARGIN_MM)
        self.cell(0, 5, f"Arm {self._values['arm']['name']}", align="R")
        self.line(_MARGIN_MM, 15.5, self.w - _MARGIN_MM, 15.5)
        self.set_y(_MARGIN_MM)

    def footer(self) -> None:
        self._font(_NOTE_PT, colour=_GREY)
        self.set_y(-14.0)
        self.cell(0, 5, f"SHA-256 {self._values['digest']['digest'][:32]}…")
        self.set_x(-_MARGIN_MM - 25.0)
        self.cell(0, 5, f"page {self.page_no()} of {{nb}}")

    def _font(
        self, points: float, style: str = "", colour: tuple[int, int, int] = _BLACK
    ) -> None:
        self.set_font("sans", style, points)
        self.set_text_color(*colour)

    def text_block(self, text: str, *, note: bool = False, bold: bool = False) -> None:
        size, line_mm = (_NOTE_PT, _NOTE_LINE_MM) if note else (_TEXT_PT, _LINE_MM)
        self._font(size, "B" if bold else "", _GREY if note else _BLACK)
        self.multi_cell(0, line_mm, text, align="L", new_x="LMARGIN", new_y="NEXT")
        self.ln(1.2)

    def heading(self, text: str, *, keep_mm: float = 30.0) -> None:
        """Begin a section, on a new page where too little of it would fit."""
        if self.will_page_break(keep_mm):
            self.add_page()
        self.ln(3.0)
        self._font(_HEADING_PT, "B")
        self.cell(0, 6.5, text, new_x="LMARGIN", new_y="NEXT")
        self.ln(1.0)

    def rows(
        self,
        head: Sequence[str],
        rows: Sequence[Sequence[str]],
        widths: Sequence[int],
        texts: int = 1,
    ) -> None:
        """Set a table; the first columns hold words, all others numbers."""
        self._font(8.0)
        aligned = ["LEFT"] * texts + ["RIGHT"] * (len(widths) - texts)
        with self.table(
            borders_layout=TableBordersLayout.HORIZONTAL_LINES,
            col_widths=tuple(widths),
            text_align=tuple(aligned),
            headings_style=FontFace(emphasis="BOLD", color=_BLACK, fill_color=_SHADE),
            first_row_as_headings=bool(head),
            line_height=_LINE_MM,
            padding=(0.5, 1.2),
            v_align="TOP",
        ) as table:
            for cells in ([head] if head else []) + list(rows):
                table.row(list(cells))
        self.ln(2.0)

    def verdict(self, state: str, title: str, sentences: Sequence[str]) -> None:
        """Set the verdict in a box of its colour."""
        self.ln(2.0)
        top, left = self.get_y(), _MARGIN_MM
        self.set_xy(left + 6.0, top + 2.0)
        self.set_left_margin(left + 6.0)
        self._font(13.0, "B")
        self.multi_cell(0, 6.5, title, align="L", new_x="LMARGIN", new_y="NEXT")
        for sentence in sentences:
            self.text_block(sentence)
        self.set_left_margin(left)
        bottom = self.get_y() + 1.0
        self.set_fill_color(STATE_COLOURS[state])
        self.rect(left, top, 2.2, bottom - top, style="F")
        self.set_fill_color(255)
        self.rect(left, top, self.w - 2.0 * left, bottom - top)
        self.set_xy(left, bottom + 3.0)

    def signature(self) -> None:
        if self.will_page_break(_SIGNATURE_MM):
            self.add_page()
        self.set_y(self.get_y() + _SIGNATURE_MM - 8.0)
        width = (self.w - 2.0 * _MARGIN_MM - 12.0) / 3.0
        self._font(_NOTE_PT, colour=_GREY)
        for number, what in enumerate(("place, date", "name", "signature")):
            left = _MARGIN_MM + number * (width + 6.0)
            self.set_draw_color(*_BLACK)
            self.line(left, self.get_y(), left + width, self.get_y())
            self.set_x(left)
            self.cell(width, 5, what)
        self.set_draw_color(*_RULE)
        self.ln(8.0)


def certificate_pdf(values: Mapping[str, Any], files: Mapping[str, bytes]) -> bytes:
    """Make the document.

    The files are attached.
    """
    document = _Document(values)
    _first_page(document, values)
    _definitions(document, values)
    _correlation(document, values)
    for title, height_mm, paint in paintings(values):
        document.heading(title, keep_mm=height_mm + 14.0)
        png = picture(WIDTH_MM, height_mm, paint)
        document.image(io.BytesIO(png), w=WIDTH_MM, h=height_mm)
    _digests(document, values)
    for name, content in sorted(files.items()):
        document.embed_file(bytes=content, basename=name, compress=True)
    return bytes(document.output())


def _first_page(document: _Document, values: Mapping[str, Any]) -> None:
    document.set_font("sans", "B", _TITLE_PT)
    document.cell(0, 9, WORDS.heading(values), new_x="LMARGIN", new_y="NEXT")
    document.text_block(f"{values['title']}; arm {values['arm']['name']}")
    document.verdict(values["state"], values["conclusion"], values["sentences"])
    document.heading("Figures")
    document.rows(
        WORDS.lines("columns", values),
        [figure_cells(figure) for figure in values["figures"]],
        (34, 42, 20, 24, 12, 18, 20),
        texts=2,
    )
    document.text_block(WORDS.basis(values), note=True)
    for remark in [
        *(f"{f['name']}: {entry}" for f in values["figures"] for entry in f["remarks"]),
        *values["remarks"],
    ]:
        document.text_block(f"{remark[0].upper()}{remark[1:]}.", note=True)
    if values["missing"]:
        document.heading("Missing")
        rows = missing_rows(values)
        document.rows(("not computed", "because"), rows, (45, 125), texts=2)
    if comparison := comparison_cells(values):
        document.heading("As found, as left, and before")
        widths = (45, 25, 25, 25, 25, 25)
        document.rows(COMPARISON_COLUMNS, comparison, widths)
        document.text_block(WORDS.comparison(values), note=True)
    document.heading("Measurement", keep_mm=60.0)
    document.rows((), administration_rows(values), (45, 125), texts=2)
    # A signature alone on a page would be of nothing.
    with document.offset_rendering() as tried:
        _standards(cast("_Document", tried), values)  # it plays the same part
    if tried.page_break_triggered:
        document.add_page()
    _standards(document, values)


def _standards(document: _Document, values: Mapping[str, Any]) -> None:
    """Set the standards, and below them the signature."""
    if values["administration"]["standards"]:
        document.heading("Standards")
        document.rows(
            STANDARD_COLUMNS,
            standard_cells(values),
            (18, 19, 19, 28, 19, 19, 23, 25),
            texts=8,
        )
        document.text_block(WORDS.traceability(values), note=True)
    if values["verdict"] != "withheld":
        document.signature()


def _definitions(document: _Document, values: Mapping[str, Any]) -> None:
    document.heading("Definitions, uncertainties and parts", keep_mm=90.0)
    document.text_block(WORDS.uncertainty(), note=True)
    for figure in values["figures"]:
        if document.will_page_break(30.0):
            document.add_page()
        document.text_block(figure["name"], bold=True)
        document.text_block(WORDS.definition(values, figure))
        widths = (36, 60, 12, 16, 22, 24)
        document.rows(BUDGET_COLUMNS, budget_cells(figure), widths, texts=5)
        document.text_block(WORDS.together(values, figure), note=True)
        parts = [(part["name"], f"{part['value_mm']:.4f}") for part in figure["parts"]]
        if parts:
            document.rows(("part", "mm"), parts, (110, 60))


def _correlation(document: _Document, values: Mapping[str, Any]) -> None:
    head, rows = correlation_table(values)
    if len(rows) > 1:
        document.heading("Correlation")
        document.text_block(WORDS.correlated(values), note=True)
        each = 100 // len(rows)
        document.rows(head, rows, (170 - each * len(rows), *[each] * len(rows)))


def _digests(document: _Document, values: Mapping[str, Any]) -> None:
    digest = values["digest"]
    document.heading("Data and digests")
    document.text_block(WORDS.digests())
    rows = [
        *sorted(digest["files"].items()),
        ("result", digest["result"]),
        ("over all", digest["digest"]),
    ]
    document.rows(("file, attached", digest["algorithm"]), rows, (40, 130), texts=2)

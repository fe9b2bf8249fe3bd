"""Small pieces of HTML: tables, pictures, paragraphs; everything is escaped here."""

import base64
from collections.abc import Iterable, Sequence
from html import escape


def paragraph(text: str) -> str:
    """Make a paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def note(text: str) -> str:
    """Make a paragraph in small type: how to read something, how it is defined."""
    return f'<p class="note">{escape(text)}</p>'


def image(png: bytes, description: str) -> str:
    """Put a picture into the page itself."""
    data = base64.b64encode(png).decode("ascii")
    return (
        f'<figure><img alt="{escape(description)}" '
        f'src="data:image/png;base64,{data}"></figure>'
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1) -> str:
    """Make a table.

    Args:
        head: Titles of the columns.
        rows: Cells as plain text.
        texts: How many of the first columns hold words; all others hold numbers.
    """
    titles = "".join(f"<th{_class(at, texts)}>{escape(t)}</th>" for at, t in _at(head))
    lines = "".join(
        "<tr>"
        + "".join(
            f"<td{_class(at, texts)}>{escape(cell)}</td>" for at, cell in _at(row)
        )
        + "</tr>\n"
        for row in rows
    )
    return (
        f'<div class="wide"><table><thead><tr>{titles}</tr></thead>\n'
        f"<tbody>{lines}</tbody></table></div>"
    )


def section(name: str, title: str, *parts: str) -> str:
    """Make a section with a heading that can be linked to."""
    body = "\n".join(parts)
    return f'<section id="{name}">\n<h2>{escape(title)}</h2>\n{body}\n</section>'


def _at(cells: Sequence[str]) -> Iterable[tuple[int, str]]:
    return enumerate(cells)


def _class(at: int, texts: int) -> str:
    return "" if at < texts else ' class="number"'

"""Text from outside, for one line of a log or a terminal, or a cell of a table."""

_FORMULA = tuple("=+-@")


def printable(text: str) -> str:
    r"""Escape unprintable characters, such as `\n` and `\x1b`, as Python does.

    So no text can begin a line, move the cursor or turn the direction of writing.
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )


def spreadsheet_cell(text: str) -> str:
    """The same for a cell of CSV: an apostrophe precedes a text like a formula."""
    return printable(f"'{text}" if text.startswith(_FORMULA) else text)

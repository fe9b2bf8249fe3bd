"""Templates of reports: pages of HTML, and sentences for pages and terminals.

A template is beside the module that fills it. Pages escape every value; sentences are
plain text that a page escapes like any other value.
"""

import base64
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, UndefinedError

from traverse.lab.report import quantities
from traverse.plurals import counted

# They do not print, or turn the direction of writing; ends of lines and tabs are none.
_HIDDEN = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
_LAB = Path(__file__).parents[1]
Filters = dict[str, Callable[..., Any]]
MissingValueError = UndefinedError

_FILTERS: Filters = {
    "number": quantities.number,
    "millimetres": quantities.millimetres,
    "quantity": quantities.quantity,
    "length_mm": quantities.length_mm,
    "counted": counted,
    "often": quantities.often,
    "probability": quantities.probability,
    "probability_of_log": quantities.probability_of_log,
    "odds": quantities.odds,
    "zip": lambda *columns: list(zip(*columns, strict=True)),
    "base64": lambda content: base64.b64encode(content).decode("ascii"),
}


class Words:
    """Sentences of a report: the macros of a template, as functions that give text.

    In a template's text a blank line ends a sentence or a line of a terminal; other
    line ends are spaces.
    """

    def __init__(self, template: str, **filters: Callable[..., Any]) -> None:
        """Read a template.

        The path is below `lab/`; filters are besides those of all reports.
        """
        environment = _environment(_LAB, tuple(filters.items()), is_html=False)
        self._macros = environment.get_template(template).module

    def __getattr__(self, macro: str) -> Callable[..., str]:
        return lambda *values: " ".join(self.lines(macro, *values))

    def lines(self, macro: str, *values: object) -> list[str]:
        """Return the sentences of a macro, indented like their first lines."""
        text: str = getattr(self._macros, macro)(*values)
        lines = []
        for part in text.split("\n\n"):
            words = part.split()
            if words:
                first = part.lstrip("\n")
                indent = first[: len(first) - len(first.lstrip())]
                lines.append(indent + " ".join(words))
        return lines


def page(template: str, filters: Filters, **values: object) -> str:
    """Make a page.

    The path is below `lab/`, or begins with the name of another folder; filters are
    besides those of all reports.

    Raises:
        MissingValueError: The template names a value that there is not.
    """
    environment = _environment(_LAB, tuple(filters.items()), is_html=True)
    return environment.get_template(template).render(values)


@cache
def _environment(
    folder: Path, filters: tuple[tuple[str, Callable[..., Any]], ...], *, is_html: bool
) -> Environment:
    """Make an environment, which keeps the templates that it has compiled."""
    environment = Environment(
        loader=FileSystemLoader([folder, folder.parent]),
        autoescape=is_html,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= _FILTERS | dict(filters)
    return environment


def _visible(value: object) -> object:
    r"""Write what nobody would see in a text as Python does, such as `\x1b`."""
    if not isinstance(value, str) or not _HIDDEN.search(value):
        return value
    return type(value)(_HIDDEN.sub(lambda match: ascii(match[0])[1:-1], value))

"""Line templates: a text with the values of a point in braces."""

from collections.abc import Mapping
from string import Formatter
from typing import Any

from traverse.protocol.printable import printable

MAX_TEMPLATE = 1000
LABELS = ("artefact", "feature")
"""Values that people choose: they may contain what separates values."""


class LineTemplate:
    r"""Text with `{name}` or `{name:.3f}`, and `\r`, `\n` and `\t`.

    A sign that separates two values is replaced by `_` within labels: else what follows
    would be read as another value.

    Args:
        specimen: a value of each known name.

    Attributes:
        names: of the values that the text contains.

    Raises:
        ValueError: it has an unknown name, more than names, an unsuitable format, or
            the decimal sign between values.
    """

    def __init__(
        self, template: str, specimen: Mapping[str, Any], decimal: str = "."
    ) -> None:
        if not template or len(template) > MAX_TEMPLATE:
            raise ValueError(
                f"a template of {len(template)} characters; expected 1 to "
                f"{MAX_TEMPLATE}, such as '{{seq}};{{x_mm:.3f}}\\n'"
            )
        for typed, character in (("\\r", "\r"), ("\\n", "\n"), ("\\t", "\t")):
            template = template.replace(typed, character)
        # Parsed by hand: str.format would give a template access to our objects.
        self._parts = list(Formatter().parse(template))
        self._decimal = decimal
        for text, name, spec, conversion in self._parts:
            if decimal != "." and decimal in text:
                raise ValueError(
                    f"template: {decimal!r} is the decimal sign and stands between "
                    "values, too; separate them by another sign, ';' say"
                )
            if name is not None and (
                name not in specimen or conversion or "{" in (spec or "")
            ):
                raise ValueError(
                    f"template: {{{name}}} is no value of a point; there are: "
                    + ", ".join(specimen)
                )
        self.names = {name for _, name, _, _ in self._parts if name is not None}
        between = [text for text, name, _, _ in self._parts[1:] if name is not None]
        self._separators = str.maketrans(
            {
                sign: "_"
                for text in between
                for sign in text.strip() or text
                if not sign.isalnum()
            }
        )
        self.filled(specimen)

    def filled(self, values: Mapping[str, Any]) -> str:
        """Fill in values; unknown ones are empty."""
        parts = []
        for text, name, spec, _ in self._parts:
            parts.append(text)
            if name is None or (value := values.get(name)) is None:
                continue
            if isinstance(value, str):
                value = printable(value)
                if name in LABELS:
                    value = value.translate(self._separators)
            try:
                written = format(value, spec or "")
            except ValueError as error:
                raise ValueError(
                    f"template: {{{name}:{spec}}}: {error}; the value is {value!r}"
                ) from error
            is_number = isinstance(value, float)
            parts.append(written.replace(".", self._decimal) if is_number else written)
        return "".join(parts)

"""Lines whose values stay apart, whatever they contain."""

import pytest

from traverse.client.exports.line_template import LineTemplate

VALUES = {"seq": 7, "x": 1.5, "artefact": "part", "feature": "bore 1;2.5, left"}


@pytest.mark.parametrize(
    ("template", "line"),
    [
        (r"{seq};{feature};{x:.3f}\n", "7;bore 1_2.5, left;1.500\n"),
        (r"{seq},{feature},{x:.3f}\n", "7,bore 1;2.5_ left,1.500\n"),
        (r"{seq}, {feature}, {x:.3f}\n", "7, bore 1;2.5_ left, 1.500\n"),
        (r"{x} {feature}\n", "1.5 bore_1;2.5,_left\n"),
        (r"{feature} mm\n", "bore 1;2.5, left mm\n"),
        (r"at {x}: {feature}\n", "at 1.5: bore 1;2.5, left\n"),
    ],
)
def test_a_label_cannot_begin_another_value(template: str, line: str) -> None:
    assert LineTemplate(template, VALUES).filled(VALUES) == line


def test_a_label_cannot_begin_another_line() -> None:
    values = VALUES | {"feature": "a\nb\tc"}
    line = LineTemplate(r"{feature}\t{x}\n", VALUES).filled(values)
    assert line == "a\\nb\\tc\t1.5\n"

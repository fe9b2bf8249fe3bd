"""Deviation from a nominal place, and when it is proved."""

import pytest

from traverse.client.display.figures import INCH, MM, expanded_axes_mm
from traverse.client.display.nominal import Nominal


@pytest.mark.parametrize(
    ("x_mm", "expanded_mm", "level"),
    [
        (0.02, 0.01, "good"),
        (0.045, 0.01, "warning"),
        (0.055, 0.01, "warning"),
        (0.07, 0.01, "bad"),
        (0.02, None, "warning"),
        (0.07, None, "warning"),
    ],
)
def test_nothing_is_proved_within_the_uncertainty_of_the_limit(
    x_mm: float, expanded_mm: float | None, level: str
) -> None:
    off = Nominal((0.0, None, 5.0), 0.05).deviation((x_mm, 99.0, 5.0), expanded_mm)
    assert off.offsets_mm == (x_mm, None, 0.0)
    assert off.distance_mm == pytest.approx(x_mm)
    assert off.decision[0] == level


def test_zero_has_no_minus_and_inches_have_their_digits() -> None:
    assert MM.text(-0.0004) == "0.000"
    assert MM.text(-0.0006) == "-0.001"
    assert MM.text(0.0, sign=True) == "+0.000"
    assert INCH.with_name(25.4) == "1.00000 inch"


def test_in_the_parts_system_the_worst_direction_counts() -> None:
    covariance = (1.0, 0.0, 0.0, 4.0, 0.0, 9.0)
    assert expanded_axes_mm(covariance, "arm") == pytest.approx([2.0, 4.0, 6.0])
    assert expanded_axes_mm(covariance, "part") == pytest.approx([6.0, 6.0, 6.0])
    assert expanded_axes_mm(None, "arm") is None

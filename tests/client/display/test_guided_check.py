"""Guided checks: figures against cases with known answers."""

import numpy as np
import pytest

from tests.client.display.values import point
from traverse.client.display.guided_check import GuidedCheck


def taken(kind: str, places: list[tuple[float, float, float]]) -> GuidedCheck:
    check = GuidedCheck(kind, len(places))
    for seq, place in enumerate(places):
        check.take(point(seq, xyz_mm=list(place), probe_radius_mm=3.0))
    return check


def test_single_points_about_their_mean() -> None:
    # Four points 0.01 from their mean: s^2 = 4 * 1e-4 / 3.
    check = taken(
        "articulation", [(1.01, 0, 0), (0.99, 0, 0), (1, 0.01, 0), (1, -0.01, 0)]
    )
    figures = {name: value for name, value, _ in check.results}
    assert figures["Largest"] == "0.0100 mm"
    assert figures["2 s"] == f"{2 * np.sqrt(4e-4 / 3):.4f} mm"
    assert figures["Half range"] == "0.0100 / 0.0100 / 0.0000 mm"
    assert check.is_done


def test_a_sphere_with_one_point_out() -> None:
    places = [
        (15.0, 0, 0),
        (-15.0, 0, 0),
        (0, 15.0, 0),
        (0, -15.0, 0),
        (0, 0, 15.0),
        (0, 0, -15.0),
    ]
    figures = {name: value for name, value, _ in taken("sphere", places).results}
    assert figures["Diameter"] == "24.0000 mm"  # less the ball of 3 mm on both sides
    assert figures["Form"] == "0.0000 mm"


@pytest.mark.parametrize("kind", ["articulation", "sphere"])
def test_too_few_points_give_no_figures_but_say_what_to_do(kind: str) -> None:
    check = GuidedCheck(kind, 5)
    assert check.results == []
    assert "5 more" in check.instruction
    check.take(point(0))
    assert check.results == []
    check.undo("p-0")
    assert "5 more" in check.instruction

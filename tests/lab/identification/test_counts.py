"""How many parameters data determine: the counts of the theory."""

import numpy as np
import pytest

from tests.lab.simulated import DESIGN_ARM, bar, built, cones, simulate
from traverse.lab.identification.identify import Options, identify

CORNERS = {
    f"P{i}": [float(x) for x in place]
    for i, place in enumerate(
        np.array([[600, 0, 300], [-200, 500, 500], [300, -500, 100], [0, 700, -50]])
    )
}


def determined(tables, n_each=40, **more):
    campaign = simulate(built(3), tables, n_each, 11)
    result = identify(campaign, DESIGN_ARM, Options(snooping=False, **more))
    assert result.converged
    return result


def test_cones_alone_determine_all_but_the_scale():
    result = determined(cones(4))
    assert result.adjustment.network.parameters.n_free == 4 * 7 - 3
    assert result.adjustment.split.n_determined == 4 * 7 - 4


@pytest.mark.parametrize(
    "tables",
    [
        [{"id": f"s{i}", "kind": "sphere"} for i in range(5)],
        [{"id": f"p{i}", "kind": "plane"} for i in range(8)],
    ],
)
def test_surfaces_without_a_length_determine_all_but_the_scale(tables):
    # The probe's radius is no length where the surface is unknown.
    result = determined(tables, 60)
    assert result.adjustment.split.n_determined == 4 * 7 - 4
    assert "no length" in result.undetermined[0].why


def test_one_length_determines_the_scale_too():
    result = determined([*cones(3), bar()])
    assert result.adjustment.split.n_determined == 4 * 7 - 3
    assert result.undetermined == ()


def test_points_in_the_arms_system_are_the_datum():
    table = {"id": "net", "kind": "points", "frame": "arm", "points_mm": CORNERS}
    result = determined([table], 160)
    assert result.adjustment.network.parameters.n_free == 4 * 7 + 3
    assert result.adjustment.split.n_determined == 4 * 7 + 3


def test_points_with_a_scale_of_their_own_give_no_length():
    table = {
        "id": "net",
        "kind": "points",
        "frame": "own_scaled",
        "points_mm": {"A": [0.0, 0, 0], "B": [200.0, 0, 0], "C": [0.0, 150, 0]},
        "true_scale": 1.003,
    }
    result = determined([table, *cones(3)], 60)
    assert result.adjustment.split.n_determined == 4 * 7 - 4


def test_redundancy_counts_equations_less_unknowns():
    result = determined([*cones(3), bar()])
    equations = 3 * 3 * 40 + 40 + 3  # three certified lengths
    assert result.redundancy == equations - 3 * 3 - 8 - 25

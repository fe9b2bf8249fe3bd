"""How many parameters data determine, and how well: the figures of the theory."""

from dataclasses import dataclass

import numpy as np
import pytest

from lab.identification.identify import Options, identify
from tests.lab.simulated import (
    arm_value,
    bar,
    cones,
    disturbed,
    seven_joints,
    simulate,
)

PLAIN = Options(snooping=False, n_suggestions=0)
CORNERS = {
    f"P{i}": [float(x) for x in place]
    for i, place in enumerate(
        np.array([[600, 0, 300], [-200, 500, 500], [300, -500, 100], [0, 700, -50]])
    )
}


def determined(tables, n_each=40, **more):
    design = seven_joints()
    campaign = simulate(disturbed(design, 3), tables, n_each, 11)
    result = identify(campaign, arm_value(design), Options(snooping=False, **more))
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


@dataclass(frozen=True)
class Harmonics:
    """Encoder errors cos and sin of order times the reading, of every joint."""

    order: int
    n_joints: int

    @property
    def names(self):
        return tuple(
            f"J{k + 1}.h{self.order}.{part}"
            for k in range(self.n_joints)
            for part in ("cos", "sin")
        )

    @property
    def units(self):
        return ("rad",) * (2 * self.n_joints)

    @property
    def tolerances(self):
        return (1.0,) * (2 * self.n_joints)

    def columns(self, geometry, derivatives, poses):
        angles = self.order * poses.angles_rad[:, np.newaxis, :]
        parts = [
            derivatives.by_angles * np.cos(angles),
            derivatives.by_angles * np.sin(angles),
        ]
        joined = np.stack(parts, axis=3)
        return joined.reshape(*joined.shape[:2], -1)


def condition(hinge_deg, roll_deg, orders, seed):
    design = seven_joints()
    travel = np.radians([roll_deg, hinge_deg] * 3 + [roll_deg])
    pair = {
        "id": "pair",
        "kind": "points",
        "frame": "own",
        "points_mm": {"A": [0.0, 0, 0], "B": [300.0, 0, 0]},
    }
    rng = np.random.default_rng(seed)
    middles = design.centres(design.zeros_rad + rng.uniform(-0.5, 0.5, (6, 7)) * travel)
    tables = [*cones(5), pair]
    for table, middle in zip(tables, middles, strict=True):
        table["place_mm"] = middle
    campaign = simulate(design, tables, 17, seed, travel_rad=travel)
    terms = tuple(Harmonics(order, 7) for order in orders)
    options = Options(terms=terms, snooping=False, coarse_start=False, n_suggestions=0)
    return identify(campaign, arm_value(design), options).condition_number


@pytest.mark.slow
def test_condition_numbers_grow_as_travel_shrinks_and_harmonics_join():
    travels = [(180, 180), (75, 150), (40, 60)]
    table = np.array(
        [
            [condition(*travel, orders, 1) for orders in ((), (1,), (1, 2))]
            for travel in travels
        ]
    )
    assert np.all(np.diff(table, axis=1) > 0)
    assert np.all(np.diff(table, axis=0) > 0)
    # Mild with whole turns, hopeless for second harmonics with little travel.
    assert table[0].max() < 150
    assert table[2, 2] > 50 * table[0, 2]

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from traverse.kinematics.helmert.symmetry import MOST_POINTS, other_orders

BOX = np.array(list(itertools.product((0.0, 900), (0, 500), (0, 300))))
CUBE = np.array(list(itertools.product((0.0, 1), (0, 1), (0, 1)))) * 200.0
RING = 250.0 * np.array(
    [[np.cos(a), np.sin(a), 0.0] for a in np.arange(6) * np.pi / 3.0]
)


@pytest.mark.parametrize(
    ("places_mm", "n_orders"),
    [
        (BOX, 3),
        (CUBE, 23),
        (RING, 11),
        (RING[:3], 1),  # isosceles
        (BOX[:3], 0),  # 300, 500 and the diagonal
        (np.array([*BOX, [450.0, 250, 350]]), 1),
        (np.array([*BOX, [100.0, 250, 350]]), 0),
    ],
)
def test_the_rotations_of_a_body_are_all_found(places_mm, n_orders):
    rng = np.random.default_rng(4)
    turned_mm = places_mm @ Rotation.random(random_state=rng).as_matrix() + 700.0
    orders = other_orders(turned_mm, 0.0)
    assert len(orders) == n_orders
    assert all(sorted(of.order) == [*range(len(places_mm))] for of in orders)


def test_the_turn_is_that_of_the_points():
    turns = {round(np.degrees(of.turn_rad)) for of in other_orders(RING, 0.01)}
    assert turns == {60, 120, 180}


@pytest.mark.parametrize(("off_mm", "n_orders"), [(0.05, 3), (1.0, 0)])
def test_orders_fit_within_the_errors(off_mm, n_orders):
    places_mm = BOX + [[off_mm, 0.0, 0.0]] * (np.arange(8) == 0)[:, np.newaxis]
    assert len(other_orders(places_mm, 0.05)) == n_orders


def test_too_many_points_are_not_looked_at():
    grid = np.array(list(itertools.product(range(9), range(9), [0.0]))) * 50.0
    assert len(grid) > MOST_POINTS
    assert other_orders(grid, 0.01) == []

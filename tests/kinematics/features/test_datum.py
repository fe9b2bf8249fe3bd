"""3-2-1 of features against a part whose system is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.kinematics.features.test_features import element
from traverse.kinematics.features.datum import datum_system


@given(seed=st.integers(0, 10_000), sense=st.sampled_from([1.0, -1.0]))
def test_features_of_a_known_system_lead_into_it(seed, sense):
    rng = np.random.default_rng(seed)
    turn, shift_mm = Rotation.random(random_state=seed), rng.uniform(-900, 900, 3)

    def placed(kind, place_mm, direction=(0.0, 0.0, 0.0)):
        return element(kind, turn.apply(place_mm) + shift_mm, turn.apply(direction))

    plane = placed("plane", [30.0, 20.0, 0.0], [0.0, 0.0, 1.0])
    line = placed("line", [50.0, 0.0, -3.0], sense * np.array([0.99, 0.0, 0.14]))
    point = placed("circle", [0.0, 40.0, 7.0], [0.0, 0.0, 1.0])
    system = datum_system(plane, line, point, turn.apply([1.0, 0.0, 0.0]))
    part_mm = rng.uniform(-100, 100, (4, 3))
    np.testing.assert_allclose(
        system.places_mm(turn.apply(part_mm) + shift_mm), part_mm, atol=1e-9
    )


def test_what_makes_no_system_is_refused():
    up = (0, 0, 1)
    plane = element("plane", (0, 0, 0), up)
    point = element("point", (0, 0, 0))
    with pytest.raises(ValueError, match="not plane, plane, point"):
        datum_system(plane, plane, point, np.ones(3))
    with pytest.raises(ValueError, match="stands on the plane"):
        datum_system(plane, element("line", (0, 0, 0), up), point, np.ones(3))

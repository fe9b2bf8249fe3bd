"""Arms that the tests of kinematics share."""

import numpy as np
from hypothesis import strategies as st

from traverse.kinematics.model.geometry import Geometry, unit_vectors

ARM_TEXT = """\
schema = "traverse/arm/1"
name = "bench-7"
origin_mm = [1.0, -2.0, 3.5]

[[joints]]
name = "J1"
axis = [0.0, 0.0, 2.0]
link_mm = [0.0, 10.0, 250.0]
zero_rad = 1.234
mass_kg = 2.0
centre_of_mass_mm = [0.0, 0.0, 125.0]
[joints.encoder]
counts_per_turn = 8388608
sign = 1
source = "base/0"

[[joints]]
name = "J2"
axis = [0.0, 1.0, 0.0]
link_mm = [0.0, 0.0, 300.0]
zero_rad = -0.5
[joints.encoder]
counts_per_turn = 4294967296
sign = -1
source = "base/1"

[probe]
radius_mm = 3.0
kind = "hard"
vector_mm = [0.0, 0.0, 50.0]
direction = [0.0, 0.0, 1.0]
mass_kg = 0.2

[reference]
temperature_c = 20.0
gravity_m_s2 = [0.0, 0.0, -9.80665]
"""


def random_geometry(seed: int, n_joints: int) -> Geometry:
    """An arm without any symmetry, its elements up to a metre long."""
    rng = np.random.default_rng(seed)
    return Geometry(
        origin_mm=rng.uniform(-500, 500, 3),
        axes=unit_vectors(rng.normal(size=(n_joints, 3))),
        links_mm=rng.uniform(-500, 500, (n_joints, 3)),
        zeros_rad=rng.uniform(-10, 10, n_joints),
        probe_vector_mm=rng.uniform(-100, 100, 3),
        probe_direction=unit_vectors(rng.normal(size=3)),
    )


def size_mm(geometry: Geometry) -> float:
    """What 1e-12 relative is relative to: the stretched arm and its place."""
    lengths = np.linalg.norm(geometry.links_mm, axis=1).sum()
    return float(
        lengths
        + np.linalg.norm(geometry.origin_mm)
        + np.linalg.norm(geometry.probe_vector_mm)
    )


geometries = st.builds(
    random_geometry, st.integers(0, 2**32 - 1), st.integers(min_value=1, max_value=8)
)
seeds = st.integers(0, 2**32 - 1)

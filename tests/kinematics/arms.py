import numpy as np
from hypothesis import strategies as st

from tests.arm_files import arm_text, joint_text
from traverse.kinematics.model.geometry import Geometry, unit_vectors

ARM_TEXT = arm_text(
    "bench-7",
    joint_text(
        *("J1", [0.0, 0.0, 2.0], [0.0, 10.0, 250.0], 1.234, (1 << 23, 1, "base/0")),
        more="mass_kg = 2.0\ncentre_of_mass_mm = [0.0, 0.0, 125.0]\n",
    ),
    joint_text("J2", [0.0, 1.0, 0.0], [0.0, 0.0, 300.0], -0.5, (1 << 32, -1, "base/1")),
    origin_mm=[1.0, -2.0, 3.5],
    probe='radius_mm = 3.0\nkind = "hard"\nvector_mm = [0.0, 0.0, 50.0]\n'
    "direction = [0.0, 0.0, 1.0]\nmass_kg = 0.2",
)


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
    """Length that relative errors refer to: the stretched arm and its place."""
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

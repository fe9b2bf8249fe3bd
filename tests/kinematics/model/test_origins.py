import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.kinematics.arms import random_geometry, seeds
from tests.kinematics.importers.matrices import rotation
from traverse.kinematics.importers.dh import geometry_from_dh, nearest_table
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.model.origins import (
    length_mm,
    near_origins,
    slid_origins,
    slides_mm,
)

# A UR10's hinges in its zero posture, with the tilts of a calibration.
AXES = [[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, -1, 0], [0, 0, -1], [0, -1, 0]]
LINKS_MM = [
    [0, 0, 127.3],
    [-612, 0, 0],
    [-572.3, 0, 0],
    [0, -163.9, 0],
    [0, 0, -115.7],
    [0, -92.2, 0],
]


def calibrated(tilt_rad):
    rng = np.random.default_rng(7)
    axes = [
        rotation(unit_vectors(rng.normal(size=3)), tilt_rad)[:3, :3] @ axis
        for axis in AXES
    ]
    return Geometry(
        origin_mm=np.zeros(3),
        axes=unit_vectors(axes),
        links_mm=LINKS_MM,
        zeros_rad=np.zeros(6),
        probe_vector_mm=np.zeros(3),
        probe_direction=[0, -1, 0],
    )


@given(seeds, st.integers(1, 7))
def test_slid_origins_move_nothing(seed, n_joints):
    geometry = random_geometry(seed, n_joints)
    slid = slid_origins(geometry)
    readings_rad = np.random.default_rng(seed).uniform(-4, 4, (5, n_joints))
    before, after = probe_pose(geometry, readings_rad), probe_pose(slid, readings_rad)
    size_mm = length_mm(geometry) + length_mm(slid)
    np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-10 * size_mm)
    np.testing.assert_allclose(after[1], before[1], rtol=0, atol=1e-12)
    moved_mm = slides_mm(geometry, slid)
    across = np.cross(moved_mm, geometry.axes)
    np.testing.assert_allclose(across, 0.0, rtol=0, atol=1e-10 * size_mm)


@pytest.mark.parametrize("tilt_rad", [1e-3, 1e-5])
def test_a_calibrated_table_reaches_as_far_as_its_arm(tilt_rad):
    arm = calibrated(tilt_rad)
    table = nearest_table(arm, 1e-9).table
    assert np.abs(table.d_mm).max() > 10_000  # metres away, and right
    far = geometry_from_dh(table, np.zeros(6))
    near = near_origins(far)
    assert length_mm(far) > 20_000
    assert length_mm(near) == pytest.approx(length_mm(arm), rel=0.2)
    readings_rad = np.random.default_rng(1).uniform(-3, 3, (20, 6))
    gap_mm = probe_pose(near, readings_rad)[0] - probe_pose(arm, readings_rad)[0]
    assert np.abs(gap_mm).max() < 1e-12 * length_mm(far)


def test_origins_that_are_near_stay_bit_for_bit():
    arm = calibrated(1e-4)
    assert near_origins(arm) is arm

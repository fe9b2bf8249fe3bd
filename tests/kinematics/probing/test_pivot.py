import numpy as np
import pytest

from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.probing.pivot import fit_pivot

TRUE_VECTOR_MM = np.array([4.0, -7.0, 120.0])


def wrist(vector_mm) -> Geometry:
    """Three axes that meet at the wrist: the ball can stay while they turn."""
    return Geometry(
        origin_mm=np.array([100.0, 50.0, 20.0]),
        axes=unit_vectors([[0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        links_mm=np.array(
            [[0, 0, 300.0], [0, 0, 280], [0, 0, 0], [0, 0, 0], [0, 0, 9]]
        ),
        zeros_rad=np.zeros(5),
        probe_vector_mm=vector_mm,
        probe_direction=np.array([0.0, 0.0, 1.0]),
    )


def moved(angles_rad, by_mm):
    """Postures whose true balls are elsewhere by (n, 3), to the first order."""
    known = probe_derivatives(wrist(TRUE_VECTOR_MM), angles_rad)
    steps = np.linalg.pinv(known.by_angles) @ by_mm[..., np.newaxis]
    return angles_rad + steps[..., 0]


def pivoted(angles_rad):
    """Fit postures, from a vector that is far off."""
    begun_mm = np.array([0.0, 0.0, 100.0])
    known = probe_derivatives(wrist(begun_mm), angles_rad)
    return fit_pivot(begun_mm, known.centres_mm, known.by_probe_vector)


def seated(n):
    seat = np.array([350.0, 150.0, 250.0])
    angles_rad = np.random.default_rng(3).uniform(-1.2, 1.2, (20 * n, 5))
    for _ in range(40):
        centres_mm, _ = probe_pose(wrist(TRUE_VECTOR_MM), angles_rad)
        angles_rad = moved(angles_rad, np.clip(seat - centres_mm, -50, 50))
    centres_mm, _ = probe_pose(wrist(TRUE_VECTOR_MM), angles_rad)
    is_seated = np.linalg.norm(centres_mm - seat, axis=1) < 1e-9
    return angles_rad[is_seated][:n], seat


def test_the_vector_is_found_exactly_without_noise():
    angles_rad, seat = seated(8)
    pivot = pivoted(angles_rad)
    np.testing.assert_allclose(pivot.vector_mm, TRUE_VECTOR_MM, atol=1e-6)
    np.testing.assert_allclose(pivot.seat_mm, seat, atol=1e-6)
    assert pivot.rms_mm < 1e-6
    assert pivot.redundancy == 18


def test_its_covariance_says_how_far_noise_leads_it_astray():
    angles_rad, _ = seated(10)
    rng = np.random.default_rng(4)
    normalised = []
    for _ in range(300):
        noisy_rad = moved(angles_rad, 0.02 * rng.normal(size=(10, 3)))
        pivot = pivoted(noisy_rad)
        off = pivot.vector_mm - TRUE_VECTOR_MM
        normalised.append(off @ np.linalg.solve(pivot.covariance_mm2, off) / 3)
    # Mean of F(3, 24) is 24 / 22, its standard deviation 1.0: of 300 draws 0.06.
    assert np.mean(normalised) == pytest.approx(24 / 22, abs=0.2)


def test_poses_that_hardly_differ_are_refused():
    angles_rad, _ = seated(6)
    alike = np.repeat(angles_rad[:1], 6, axis=0) + 1e-5 * np.arange(6)[:, np.newaxis]
    with pytest.raises(ValueError, match="hardly differ"):
        pivoted(alike)
    with pytest.raises(ValueError, match="at least 4"):
        pivoted(angles_rad[:3])

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from traverse.simulator.arm.physics import Mechanism, probe_pose, probe_rates

ANGLES = arrays(np.float64, (1, 7), elements=st.floats(-6.3, 6.3))


def planar_arm(first_mm: float, second_mm: float) -> Mechanism:
    return Mechanism(
        origins_mm=np.array([[0.0, 0.0, 0.0], [first_mm, 0.0, 0.0]]),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
        probe_mm=np.array([first_mm + second_mm, 0.0, 0.0]),
        shank=np.array([1.0, 0.0, 0.0]),
    )


def random_seven() -> Mechanism:
    rng = np.random.default_rng(8)
    axes = rng.standard_normal((7, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    origins = 300.0 * rng.standard_normal((7, 3))
    return Mechanism(origins, axes, origins[-1] + 100.0, np.array([0.6, 0.0, 0.8]))


def test_elbow_at_a_right_angle():
    centres, shanks = probe_pose(
        planar_arm(400.0, 300.0), np.array([[0.0, np.pi / 2], [np.pi / 2, 0.0]])
    )
    np.testing.assert_allclose(centres, [[400, 300, 0], [0, 700, 0]], atol=1e-10)
    np.testing.assert_allclose(shanks, [[0, 1, 0], [0, 1, 0]], atol=1e-15)


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_two_hinges_in_a_plane_follow_the_closed_form(a, b):
    centres, _ = probe_pose(planar_arm(400.0, 300.0), np.array([[a, b]]))
    expected = [
        400 * np.cos(a) + 300 * np.cos(a + b),
        400 * np.sin(a) + 300 * np.sin(a + b),
        0.0,
    ]
    np.testing.assert_allclose(centres[0], expected, atol=1e-9)


@given(ANGLES)
@settings(max_examples=40)
def test_a_body_keeps_its_distances(angles):
    arm = random_seven()
    before = arm.probe_mm - arm.origins_mm[-1]
    stub = Mechanism(arm.origins_mm, arm.axes, arm.origins_mm[-1], arm.shank)
    tip, shank = probe_pose(arm, angles)
    bearing, _ = probe_pose(stub, angles)
    np.testing.assert_allclose(
        np.linalg.norm(tip - bearing), np.linalg.norm(before), rtol=1e-12
    )
    np.testing.assert_allclose(
        (tip - bearing)[0] @ shank[0], before @ arm.shank, atol=1e-9
    )


@given(ANGLES)
@settings(max_examples=40)
def test_whole_turns_change_nothing(angles):
    arm = random_seven()
    centres, _ = probe_pose(arm, angles)
    turned, _ = probe_pose(arm, angles + 2.0 * np.pi)
    np.testing.assert_allclose(turned, centres, atol=1e-9)


def test_rates_are_the_derivatives():
    arm, step = random_seven(), 1e-6
    angles = np.random.default_rng(1).uniform(-3, 3, (4, 7))
    _, _, centre_rates, shank_rates = probe_rates(arm, angles)
    for joint in range(7):
        moved = np.zeros(7)
        moved[joint] = step
        ahead, behind = probe_pose(arm, angles + moved), probe_pose(arm, angles - moved)
        for after, before, rates in zip(
            ahead, behind, (centre_rates, shank_rates), strict=True
        ):
            np.testing.assert_allclose(
                rates[:, :, joint], (after - before) / (2 * step), atol=2e-6
            )

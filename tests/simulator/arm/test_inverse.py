import numpy as np

from traverse.simulator.arm.inverse import Reach
from traverse.simulator.arm.physics import probe_pose

LIMITS = np.tile([-2.9, 2.9], (7, 1))


def test_targets_in_reach_are_met_exactly_within_limits_and_tilt(seven):
    rng = np.random.default_rng(2)
    targets = np.array([500.0, 0.0, 50.0]) + rng.uniform(-150, 150, (30, 3))
    shanks = np.tile([0.0, 0.0, -1.0], (30, 1))
    turns, reached = Reach(seven, LIMITS, rng).postures(targets, shanks, 1.0)
    assert np.all(reached)
    assert np.all(np.abs(turns) <= 2.9)
    centres, directions = probe_pose(seven, turns)
    np.testing.assert_allclose(centres, targets, atol=1e-9, rtol=0)
    assert np.all(directions @ [0.0, 0.0, -1.0] >= np.cos(1.0))


def test_equal_targets_get_different_postures(seven):
    targets = np.tile([500.0, 0.0, 50.0], (6, 1))
    reach = Reach(seven, LIMITS, np.random.default_rng(2))
    turns, _ = reach.postures(targets, np.tile([0.0, 0.0, -1.0], (6, 1)), 1.0)
    assert np.all(np.std(turns, axis=0) > 0.1)


def test_a_target_out_of_reach_is_not_reached(seven):
    targets = np.array([[500.0, 0.0, 0.0], [5000.0, 0.0, 0.0]])
    reach = Reach(seven, LIMITS, np.random.default_rng(2))
    _, reached = reach.postures(targets, np.tile([0.0, 0.0, -1.0], (2, 1)), 3.0)
    assert reached.tolist() == [True, False]

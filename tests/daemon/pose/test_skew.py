"""The error left by reading joints at different instants, in millimetres."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.values import SetClock, arm_model, count_samples
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import JointCounts
from traverse.daemon.pose.uncertainty import SkewMonitor
from traverse.kinematics.model.forward import probe_centre
from traverse.protocol.messages import QualityFlag


@pytest.fixture
def model(tmp_path):
    return arm_model(tmp_path)


def levers_mm(model, angles_rad):
    """How far a count of each joint moves the ball, by turning it a little."""
    turned = angles_rad + np.diag(np.full(3, 1e-6))
    moved_mm = probe_centre(model.geometry, turned) - probe_centre(
        model.geometry, angles_rad[np.newaxis]
    )
    return np.linalg.norm(moved_mm, axis=1) / 1e-6 * np.abs(model.per_count_rad)


def test_motion_adds_up_and_instants_add_as_squares(model):
    poses = Pipeline(model, SetClock()).poses(count_samples(np.full((4, 3), 1000)))
    doubts = np.zeros((4, 3, 2))
    doubts[1, :, 0] = 10.0, 200.0, 3000.0
    doubts[2, :, 1] = 10.0, 200.0, 3000.0
    doubts[3] = doubts[1] + doubts[2]
    levers = levers_mm(model, poses.angles_rad[-1])
    added = float(np.array([10.0, 200.0, 3000.0]) @ levers)
    squared = float(np.linalg.norm(np.array([10.0, 200.0, 3000.0]) * levers))
    for limit_mm, flagged in (
        (1.01 * (added + squared), []),
        (0.99 * (added + squared), [3]),
        (0.99 * added, [1, 3]),
        (0.99 * squared, [1, 2, 3]),
    ):
        watch = SkewMonitor(limit_mm)
        poses.quality[:] = QualityFlag.INTERPOLATED
        watch.flag_block(model, poses, doubts)
        bits = poses.quality & QualityFlag.SKEW != 0
        assert np.flatnonzero(bits).tolist() == flagged
        assert watch.pop_largest_mm() == pytest.approx(added + squared, rel=1e-5)


def test_a_single_pose_is_flagged_beyond_the_limit_and_not_otherwise(model):
    counts = JointCounts(0, np.array([5, 6, 7], np.uint32), np.zeros(3, np.uint8))
    counts = replace(counts, error_bounds_counts=np.full((3, 2), 50.0))
    pose = Pipeline(model, SetClock()).pose_at(counts)
    watch = SkewMonitor(1e-9)
    marked = watch.with_flags(model, pose)
    assert marked.quality == pose.quality | QualityFlag.SKEW
    largest_mm = watch.pop_largest_mm()
    assert SkewMonitor(1.01 * largest_mm).with_flags(model, pose) is pose
    assert watch.pop_largest_mm() is None

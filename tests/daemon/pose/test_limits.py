"""Limits of poses against NumPy's own singular values and speeds by hand."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.daemon.values import arm_model
from traverse.daemon.config.schema import EndStopSection, QualitySection
from traverse.daemon.pose.limits import PoseLimits, SpeedTracker
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.protocol.messages import QualityFlag

MS = 1_000_000


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


def test_joints_near_their_stops_are_marked(model):
    stop = EndStopSection(joint="J2", low_rad=-1.0, high_rad=2.0, margin_rad=0.1)
    limits = PoseLimits(QualitySection(end_stops=(stop,)), model)
    turned = np.array([-1.2, -0.91, -0.89, 0.0, 1.89, 1.91])
    angles_rad = np.column_stack([np.full(6, 9.0), turned, np.full(6, -9.0)])
    marked = limits.flags_of_angles(angles_rad) == QualityFlag.END_STOP
    assert marked.tolist() == [True, True, False, False, False, True]


@given(st.integers(0, 10**6), st.floats(0.001, 0.9))
def test_a_lost_degree_of_freedom_is_what_singular_values_say(model, seed, ratio):
    random = np.random.default_rng(seed)
    angles_rad = random.uniform(-3.0, 3.0, (20, 3))
    limits = PoseLimits(QualitySection(singular_ratio=ratio), model)
    is_singular = limits.flags_of_angles(angles_rad) == QualityFlag.SINGULAR
    moves = probe_derivatives(model.geometry, angles_rad).by_angles
    smallest_mm = np.linalg.svd(moves, compute_uv=False)[:, -1]
    # Links of the arm file: (0, 10, 250), (0, 0, 300), (0, 20, 200); probe 50.
    reach_mm = np.hypot(10, 250) + 300 + np.hypot(20, 200) + 50
    clear = np.abs(smallest_mm - ratio * reach_mm) > 1e-6
    assert (is_singular == (smallest_mm < ratio * reach_mm))[clear].all()


def test_a_speed_that_is_not_known_is_not_taken_for_a_slow_one(model):
    limits = PoseLimits(QualitySection(overspeed_mm_s=100.0), model)
    flags = limits.flags_of_speed(np.array([99.0, 101.0, np.nan]))
    assert flags.tolist() == [0, QualityFlag.OVERSPEED, QualityFlag.MOTION_UNKNOWN]


def test_the_speed_of_a_pose_is_that_of_its_joints(model):
    limits = PoseLimits(QualitySection(overspeed_mm_s=100.0), model)
    angles_rad, speeds = np.array([0.3, -0.4, 0.8]), np.array([0.5, -0.2, 1.1])
    ahead = probe_derivatives(model.geometry, (angles_rad + 1e-6 * speeds)[np.newaxis])
    back = probe_derivatives(model.geometry, (angles_rad - 1e-6 * speeds)[np.newaxis])
    moved_mm = np.linalg.norm(ahead.centres_mm - back.centres_mm)
    assert limits.speed_mm_s(angles_rad, speeds) == pytest.approx(moved_mm / 2e-6)
    assert np.isnan(limits.speed_mm_s(angles_rad, None))


def test_speeds_count_over_five_milliseconds():
    times_ns = np.arange(20) * MS
    xyz_mm = np.outer(np.arange(20) * 0.05, [0.6, 0.8, 0.0])  # 50 mm/s
    speeds = SpeedTracker().speeds_mm_s(times_ns, xyz_mm)
    assert np.isnan(speeds[:5]).all()
    assert speeds[5:] == pytest.approx(np.full(15, 50.0))


def test_after_a_gap_no_speed_is_known():
    trail = SpeedTracker()
    trail.speeds_mm_s(np.arange(10) * MS, np.zeros((10, 3)))
    speeds = trail.speeds_mm_s((400 + np.arange(10)) * MS, np.ones((10, 3)))
    assert np.isnan(speeds[:5]).all()
    assert (speeds[5:] == 0.0).all()


@given(st.integers(0, 10**6), st.lists(st.integers(1, 99), max_size=8))
def test_speeds_do_not_depend_on_how_a_stream_is_cut(seed, cuts):
    random = np.random.default_rng(seed)
    times_ns = np.cumsum(random.integers(1, 4 * MS, 100))
    xyz_mm = np.cumsum(random.normal(0.0, 0.1, (100, 3)), axis=0)
    whole = SpeedTracker().speeds_mm_s(times_ns, xyz_mm)
    trail = SpeedTracker()
    parts = [
        trail.speeds_mm_s(times_ns[a:b], xyz_mm[a:b])
        for a, b in pairwise(sorted({0, 100, *cuts}))
    ]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_a_section_that_makes_no_sense_is_refused():
    for keys, words in (
        ({"refuse": ("sing",)}, "singular"),
        ({"temperature_low_c": 25.0, "temperature_high_c": 20.0}, "below"),
        ({"singular_ratio": 1.5}, "less than 1"),
    ):
        with pytest.raises(ValidationError, match=words):
            QualitySection(**keys)
    with pytest.raises(ValidationError, match="nothing is left"):
        EndStopSection(joint="J1", low_rad=0.0, high_rad=0.05)


def test_end_stops_in_degrees_are_refused():
    with pytest.raises(ValidationError, match=r"low_rad -170 .* degrees"):
        EndStopSection(joint="J1", low_rad=-170.0, high_rad=170.0)
    EndStopSection(joint="J1", low_rad=-12.5, high_rad=12.5)

"""Covariances of single points: what they are made of, and where there is none.

The error left by reading joints at different instants, in millimetres.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import IDENTITIES, ArmBench, edge
from tests.daemon.two_devices import BEGIN_NS, base, true_counts, wrist
from tests.daemon.values import ARM, SetClock, arm_file, arm_model, count_samples
from traverse.daemon.config.schema import UncertaintySection
from traverse.daemon.inputs import StartupError, read_inputs
from traverse.daemon.pose.arm_model import read_model
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.poses import JointCounts
from traverse.daemon.pose.uncertainty import (
    CovarianceEvaluator,
    CovarianceInput,
    SkewMonitor,
)
from traverse.daemon.scans.plan import ScanPlan
from traverse.drivers.base.values import DeviceUp, StreamStarted
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.forward import probe_centre
from traverse.protocol.messages import QualityFlag
from traverse.strict_toml.problems import FileError

ANGLES_RAD = np.array([1.5, -0.2, 0.9])
COVARIANCE_FILE = 'covariance_file = "arm.cov.npz"'
KNOWN = f"{ARM}[identification]\n{COVARIANCE_FILE}\n"


def jacobian(model):
    step = 1e-6
    moved = [
        probe_centre(model.geometry, (ANGLES_RAD + sign * step * row)[np.newaxis])[0]
        for row in np.eye(3)
        for sign in (1, -1)
    ]
    return np.array(
        [(moved[2 * i] - moved[2 * i + 1]) / (2 * step) for i in range(3)]
    ).T


def full(six):
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def stated(model, settings, **changes):
    reading = CovarianceInput(
        Block(ANGLES_RAD[np.newaxis]), **{"speeds_rad_s": np.zeros((1, 3)), **changes}
    )
    return full(CovarianceEvaluator(settings).covariance(model, reading).own_mm2)


def test_parts_are_those_of_the_law(tmp_path):
    model = arm_model(tmp_path)
    by_angles = jacobian(model)
    steps = model.per_count_rad**2 / 12.0
    nothing = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=0)
    counts_only = by_angles @ np.diag(steps) @ by_angles.T
    assert stated(model, nothing) == pytest.approx(counts_only, rel=1e-6)
    some = UncertaintySection(encoder_rad=1e-5, contact_mm=0.01, trigger_s=0)
    expected = by_angles @ np.diag(steps + 1e-10) @ by_angles.T + 1e-4 * np.eye(3)
    assert stated(model, some) == pytest.approx(expected, rel=1e-6)
    late = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=1e-3)
    speeds = np.array([0.5, -1.0, 0.2])
    way_mm = by_angles @ speeds * 1e-3
    expected = counts_only + np.outer(way_mm, way_mm)
    covariance = stated(model, late, speeds_rad_s=speeds[np.newaxis])
    assert covariance == pytest.approx(expected, rel=1e-5)
    # An instant within +-3 ms, all as likely, has a standard deviation of sqrt(3) ms.
    covariance = stated(
        model, late, speeds_rad_s=speeds[np.newaxis], jitter_ns=3_000_000
    )
    curved_rad2 = (5.0 * 0.003**2 / 2.0) ** 2 / 3.0
    expected = counts_only + 4.0 * np.outer(way_mm, way_mm)
    expected += curved_rad2 * by_angles @ by_angles.T
    assert covariance == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("jitter_ns", "is_stated"), [(99_000_000, True), (100_000_000, False)]
)
def test_an_instant_without_a_bound_has_no_covariance(tmp_path, jitter_ns, is_stated):
    reading = CovarianceInput(
        Block(ANGLES_RAD[np.newaxis]),
        np.zeros((1, 3)),
        jitter_ns=jitter_ns,
    )
    model, evaluator = arm_model(tmp_path), CovarianceEvaluator(UncertaintySection())
    assert (evaluator.covariance(model, reading).own_mm2 is not None) == is_stated
    (of_block_mm2,) = evaluator.covariances_mm2(model, reading)
    assert np.isfinite(of_block_mm2).all() == is_stated


def test_an_arm_that_begins_to_move_stays_within_four_deviations(tmp_path):
    """Its speed is not yet seen at an instant that is known to 30 ms only."""
    model = arm_model(tmp_path)
    nothing = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=0)
    std_mm = np.sqrt(np.trace(stated(model, nothing, jitter_ns=30_000_000)))
    for joint, accelerated_rad_s2 in zip(np.eye(3), (2.0, 6.0, 10.0), strict=True):
        later_rad = ANGLES_RAD + joint * accelerated_rad_s2 * 0.03**2 / 2.0
        places_mm = probe_centre(model.geometry, np.stack([ANGLES_RAD, later_rad]))
        assert np.linalg.norm(np.diff(places_mm, axis=0)) < 4.0 * std_mm


def test_interpolation_adds_what_it_may_have_left(tmp_path):
    model = arm_model(tmp_path)
    by_angles = jacobian(model)
    nothing = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=0)
    doubts = np.array([[3.0, 4.0], [0.0, 100.0], [500.0, 0.0]])
    may_be = (doubts * np.abs(model.per_count_rad)[:, np.newaxis]) ** 2
    may_be = may_be @ np.array([1.0, 1.0 / 3.0])
    expected = by_angles @ np.diag(may_be) @ by_angles.T
    with_doubts = stated(model, nothing, error_bounds_counts=doubts[np.newaxis])
    more = with_doubts - stated(model, nothing)
    assert more == pytest.approx(expected, rel=1e-5, abs=1e-12)


def test_a_block_has_the_covariances_of_its_samples(tmp_path):
    model, rng = arm_model(tmp_path), np.random.default_rng(2)
    evaluator = CovarianceEvaluator(UncertaintySection())
    angles_rad, speeds_rad_s = rng.normal(size=(2, 4, 3))
    bounds_counts = rng.uniform(0.0, 300.0, (4, 3, 2))
    speeds_rad_s[2] = np.nan  # after a reading that was invalid

    def reading(rows):
        block = Block(angles_rad[rows])
        of_rows = speeds_rad_s[rows], bounds_counts[rows]
        return CovarianceInput(block, *of_rows, jitter_ns=2_000_000)

    covariances_mm2 = evaluator.covariances_mm2(model, reading(slice(None)))
    for row in range(4):
        expected_mm2 = evaluator.covariance(model, reading([row])).own_mm2
        if expected_mm2 is None:
            assert row == 2
            assert np.isnan(covariances_mm2[row]).all()
        else:
            assert covariances_mm2[row] == pytest.approx(expected_mm2, rel=1e-12)


@pytest.fixture
async def bench(arm_bench):
    return arm_bench


async def test_points_and_live_poses_carry_it(bench):
    bench.take(wrist().samples(range(30)), base().samples(range(30)))
    bench.take(edge("handle", BEGIN_NS + 123_456_789, 7))
    (point,) = bench.points
    assert np.linalg.eigvalsh(full(point.covariance_mm2)).min() > 0.0
    shown = [live for live in bench.live if live.covariance_mm2 is not None]
    assert shown
    assert np.linalg.eigvalsh(full(shown[-1].covariance_mm2)).min() > 0.0


@pytest.mark.parametrize("bound_ns", [0, 3_000_000])
async def test_live_poses_carry_what_the_clock_leaves_open(bench, bound_ns):
    for seq in (range(30), range(30, 60)):
        blocks = (reader.samples(seq) for reader in (wrist(), base()))
        bench.take(*(replace(block, time_bound_ns=bound_ns) for block in blocks))
        bench.clock.now_ns += 300_000_000
    shown = [live for live in bench.live if live.covariance_mm2 is not None]
    way_mm = shown[-1].speed_mm_s * bound_ns * 1e-9 / np.sqrt(3.0)
    variance_mm2 = np.linalg.eigvalsh(full(shown[-1].covariance_mm2)).max()
    assert shown[-1].speed_mm_s > 100.0
    # Of two devices also what each leaves open against the other.
    assert way_mm <= np.sqrt(variance_mm2) < 0.1 + 2.5 * way_mm


async def test_points_of_scans_carry_it_as_live_poses_do(bench):
    bench.take(wrist().samples(range(30)), base().samples(range(30)))
    scanner = bench.measurement.scanner
    scanner.start(ScanPlan("s1", 100.0, 1), bench.measurement.model, "session")
    bench.take(StreamStarted("base", 2, 100.0))
    scanned = base(stream=2, first_ns=BEGIN_NS + 300_000_000)
    for first in range(0, 40, 10):
        blocks = (
            wrist().samples(range(30 + first, 42 + first)),
            scanned.samples(range(first, first + 10)),
        )
        bench.take(*(replace(block, time_bound_ns=3_000_000) for block in blocks))
        bench.clock.now_ns += 100_000_000
    scanner.stop()
    stated = {
        int(block.time_ns + dtime_ns): covariance_mm2
        for block in bench.scans
        if block.covariance_mm2 is not None
        for dtime_ns, covariance_mm2 in zip(
            block.dtime_ns, block.covariance_mm2, strict=True
        )
    }
    shown = [live for live in bench.live if live.time_ns in stated]
    assert shown
    for live in shown:
        assert tuple(stated[live.time_ns].tolist()) == live.covariance_mm2


async def test_without_a_speed_nothing_is_stated(bench):
    bench.take(wrist().samples(range(30)), base().samples(range(30)))
    bench.take(DeviceUp("base", IDENTITIES["base"], True))
    bench.take(edge("handle", BEGIN_NS + 123_456_789, 7))
    assert [point.covariance_mm2 for point in bench.points] in ([], [None])


def test_what_is_known_of_the_arm_widens_its_points(tmp_path):
    file = arm_file(tmp_path, KNOWN)
    names = ["J1.axis.x", "probe.vector.z", "origin.y"]
    variances = np.diag([1e-10, 4e-4, 9e-4])
    np.savez(tmp_path / "arm.cov.npz", names=names, covariance=variances)
    model = read_model(file, {"base": None})
    plain = arm_model(tmp_path)
    settings = UncertaintySection()
    more = stated(model, settings) - stated(plain, settings)
    assert np.trace(more) > 4e-4 + 9e-4
    assert more[1, 1] >= 9e-4


def test_a_bad_file_of_covariances_is_refused_at_the_start(tmp_path):
    file = arm_file(tmp_path, KNOWN)
    with pytest.raises(FileError) as refusal:
        read_model(file, {"base": None})
    (problem,) = refusal.value.problems
    assert problem.where == "identification.covariance_file"
    assert "remove covariance_file" in problem.message
    (tmp_path / "arm.cov.npz").write_bytes(b"no such thing")
    daemon = tmp_path / "daemon.toml"
    daemon.write_text(
        '[arm]\nfile = "arm.toml"\n[broker]\n[[device]]\nid = "base"\n'
        'driver = "latch-board"\nport = "/dev/null"\n'
    )
    with pytest.raises(StartupError, match="no covariance of an arm") as error:
        read_inputs(daemon, embedded=False)
    assert error.value.status == 2


@pytest.fixture
async def exact(tmp_path):
    nothing = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=0)
    bench = ArmBench(tmp_path, uncertainty=nothing)
    bench.up()
    yield bench
    bench.close()


@pytest.mark.slow
async def test_interpolated_points_lie_where_they_say(exact):
    """A fast motion: what the straight lines leave out is much more than the noise."""
    bench, rng = exact, np.random.default_rng(8)
    distances, off_mm = [], []
    bench.take(wrist().samples(range(32)), base().samples(range(40)))
    for number in range(400):
        end = 43 + 3 * number
        bench.take(
            wrist().samples(range(8 * (end - 3) // 10, 8 * end // 10)),
            base().samples(range(end - 3, end)),
        )
        at_ns = BEGIN_NS + int((end - 8 + 3 * rng.uniform()) * 10_000_000)
        bench.clock.now_ns = BEGIN_NS + end * 10_000_000
        before = len(bench.points)
        bench.take(edge("handle", at_ns, number))
        if len(bench.points) == before:
            continue
        true_rad = true_counts(np.array([at_ns])) * bench.model.per_count_rad
        off = bench.points[-1].xyz_mm - probe_centre(bench.model.geometry, true_rad)[0]
        covariance = full(bench.points[-1].covariance_mm2)
        distances.append(off @ np.linalg.solve(covariance, off))
        off_mm.append(np.linalg.norm(off))
    assert len(distances) > 350
    assert np.median(off_mm) > 0.01
    assert np.mean(np.array(distances) < 7.8147) > 0.95


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

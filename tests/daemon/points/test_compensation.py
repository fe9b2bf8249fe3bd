"""The touched point: by every method, with effects of the contact, and without."""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.effect_entries import effect
from tests.daemon.two_devices import BEGIN_NS, ON_TWO
from tests.daemon.values import ARM, PoseMaker, arm_file, arm_model
from traverse.daemon.config.schema import CaptureSection, InputSection
from traverse.daemon.points.capture import PointMeasurement
from traverse.daemon.points.compensation import TipCompensator, without_direction
from traverse.daemon.pose.poses import LatchedPose
from traverse.daemon.pose.trajectory import TrajectoryBuffer
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.probing.compensation import DirectionError
from traverse.protocol.messages import QualityFlag

START_NS, PERIOD_NS = 10**12, 10_000_000
SHANK = np.array([0.0, 0.6, 0.8])
AT_MM = np.array([500.0, 0.0, 100.0])
ANGLES_RAD = np.array([1.5, -0.2, 0.9])


def pose(quality=0):
    block = Block(ANGLES_RAD[np.newaxis])
    return LatchedPose(
        START_NS, np.zeros(3, np.int64), ANGLES_RAD, AT_MM, SHANK, quality, block
    )


def settings(method, **changes):
    return CaptureSection(compensation=method, **changes)


@pytest.fixture
def model(tmp_path):
    return arm_model(tmp_path)


def path_of(model, places_mm, first):
    """A path through places, one in 10 ms, the first so many periods after START."""
    path = TrajectoryBuffer()
    maker = PoseMaker(model, PERIOD_NS, START_NS + first * PERIOD_NS)
    block = maker.block(range(len(places_mm)))
    path.add(replace(block, xyz_mm=np.array(places_mm)))
    return path


def touched(model, method, path=None, other=None, quality=0, **changes):
    tip = TipCompensator(settings(method, **changes), path or TrajectoryBuffer())
    if other is not None:
        tip.air_mm = np.array(other)
    measured = PointMeasurement(model, pose(quality), None)
    measured = replace(measured, before_mm=tip.before(START_NS, AT_MM))
    return tip.compensated(measured, tip.pull(START_NS, AT_MM))


def test_without_a_method_there_is_no_surface(model):
    measured = touched(model, "none")
    assert (measured.surface_mm, measured.compensation) == (None, "none")


def test_the_shank_points_at_the_material(model):
    measured = touched(model, "shank")
    assert measured.surface_mm == pytest.approx(AT_MM + 3.0 * SHANK)
    assert measured.pose.xyz_mm == pytest.approx(AT_MM)  # the ball's centre is kept
    assert measured.compensation == "shank"


def test_the_last_place_off_the_surface_tells_where_the_probe_came_from(model):
    # It moved down 1 mm in 10 ms, rested, and the last millimetre does not count.
    z_mm = [20.0, 5.0, 2.5, 1.0, 0.0, 0.0, 0.0]
    places_mm = [AT_MM + np.array([0.5 * z, 0.0, z]) for z in z_mm]
    measured = touched(model, "pretouch", path_of(model, places_mm, -8))
    from_above = np.array([-0.5, 0.0, -1.0]) / np.hypot(0.5, 1.0)
    assert measured.surface_mm == pytest.approx(AT_MM + 3.0 * from_above)


def test_a_place_in_the_air_that_was_pressed_counts_once_and_before_the_path(model):
    path = path_of(model, [AT_MM + np.array([0.0, 9.0, 0.0])], -5)
    tip = TipCompensator(settings("pretouch"), path)
    tip.air_mm = AT_MM + np.array([4.0, 0.0, 0.0])
    measured = replace(
        PointMeasurement(model, pose(), None), before_mm=tip.before(START_NS, AT_MM)
    )
    assert tip.compensated(measured, None).surface_mm == pytest.approx(
        AT_MM - np.array([3, 0, 0])
    )
    assert tip.compensated(measured, None).surface_mm == pytest.approx(
        AT_MM - np.array([0, 3, 0])
    )


def test_a_place_in_the_air_of_another_side_is_contradicted_by_the_path(model):
    path = path_of(model, [AT_MM + np.array([0.0, 9.0, 0.0])], -5)
    tip = TipCompensator(settings("pretouch"), path)
    tip.air_mm = AT_MM + np.array([4.0, -90.0, 0.0])  # pressed, and never touched from
    measured = replace(
        PointMeasurement(model, pose(), None), before_mm=tip.before(START_NS, AT_MM)
    )
    with pytest.raises(DirectionError, match="other side of where the probe came from"):
        tip.compensated(measured, None)
    assert tip.air_mm is None  # the next touch has its own


def test_the_material_lies_away_from_where_the_probe_is_pulled(model):
    places_mm = [AT_MM + np.array([0.0, 0.0, z]) for z in (0.0, 0.0, 1.0, 2.5, 30.0)]
    path = path_of(model, places_mm, 1)
    measured = touched(model, "pulled", path)
    assert measured.surface_mm == pytest.approx(AT_MM - np.array([0.0, 0.0, 3.0]))
    late = path_of(model, places_mm, 100)  # its 2.5 mm follow after more than a second
    with pytest.raises(DirectionError, match="pull the probe off"):
        touched(model, "pulled", late)


def test_sides_are_determined_from_a_middle(model):
    middle = (500.0, 40.0, 100.0)
    outside = touched(model, "outside", middle_mm=middle)
    inside = touched(model, "inside", middle_mm=middle)
    assert outside.surface_mm == pytest.approx(AT_MM + np.array([0.0, 3.0, 0.0]))
    assert inside.surface_mm == pytest.approx(AT_MM - np.array([0.0, 3.0, 0.0]))


def test_an_unknown_direction_is_refused_and_the_point_marked(model):
    with pytest.raises(DirectionError, match="take a point in the air"):
        touched(model, "pretouch")
    marked = without_direction(PointMeasurement(model, pose(), None))
    assert marked.pose.quality == QualityFlag.SURFACE_UNKNOWN
    assert marked.surface_mm is None


def test_effects_of_the_contact_are_applied_and_the_flag_goes(tmp_path):
    radius = effect("probe_radius", radius_error_mm=0.02)
    model = arm_model(tmp_path, ARM + radius)
    unknown = QualityFlag.SURFACE_UNKNOWN | QualityFlag.TEMPERATURE
    came_from = AT_MM - 4.0 * SHANK
    measured = touched(model, "pretouch", other=came_from, quality=unknown.value)
    assert measured.pose.xyz_mm == pytest.approx(AT_MM + 0.02 * SHANK)
    assert measured.surface_mm == pytest.approx(AT_MM + 3.02 * SHANK)
    assert measured.pose.quality == QualityFlag.TEMPERATURE
    # The shank's direction is assumed: effects are left out, which the point reports.
    measured = touched(model, "shank", quality=unknown.value)
    assert measured.pose.xyz_mm == pytest.approx(AT_MM)
    assert measured.surface_mm == pytest.approx(AT_MM + 3.0 * SHANK)
    assert measured.pose.quality == unknown
    # A bent stylus bends to the side only, which the shank's direction is not.
    bending = effect("stylus_bending", compliance_mm_n=0.1)
    model = arm_model(tmp_path, ARM + bending)
    side = np.array([400.0, 0.0, 100.0])
    measured = touched(model, "outside", middle_mm=tuple(side.tolist()))
    assert np.linalg.norm(measured.pose.xyz_mm - AT_MM) > 0.05


@pytest.fixture
def make_bench(tmp_path):
    benches = []

    def make(method, text=ON_TWO, **capture):
        file = arm_file(tmp_path, text)
        assert file.exists()
        benches.append(ArmBench(tmp_path, capture={"compensation": method, **capture}))
        benches[-1].up()
        return benches[-1]

    yield make
    for bench in benches:
        bench.close()


def stream(bench, first, end):
    bench.stream(first, end, speed=1.0)
    bench.measurement.process_timeouts()


async def test_a_pulled_hit_waits_for_the_pull_and_so_does_its_acknowledgement(
    make_bench,
):
    bench = make_bench("pulled", pull_mm=100.0)
    stream(bench, 0, 20)
    bench.take(edge("handle", BEGIN_NS + 150_000_000, 7))
    assert (bench.points, bench.acknowledged("handle")) == ([], [])
    stream(bench, 20, 60)  # hundreds of mm a second
    (point,) = bench.points
    assert bench.acknowledged("handle") == [7]
    assert point.time_ns == BEGIN_NS + 150_000_000 + bench.clock.offset_ns
    assert point.compensation == "pulled"
    reach_mm = np.linalg.norm(np.array(point.surface_mm) - point.xyz_mm)
    assert reach_mm == pytest.approx(3.0)


async def test_a_hit_that_is_not_pulled_is_taken_after_its_time_and_marked(make_bench):
    bench = make_bench("pulled", pull_mm=100.0, pull_s=0.1)
    stream(bench, 0, 20)
    bench.measurement.trajectory.forget()
    bench.take(edge("handle", BEGIN_NS + 185_000_000, 7))
    bench.later(0.2)
    assert bench.points == []
    bench.later(1.0)
    (point,) = bench.points
    assert (point.compensation, point.surface_mm) == ("none", None)
    assert "surface_unknown" in point.quality.flags
    assert not point.quality.ok
    assert "capture.no_direction" in bench.codes()


async def test_points_of_a_stream_come_from_where_the_ball_was(make_bench):
    bench = make_bench("pretouch")
    stream(bench, 0, 40)
    bench.take(edge("handle", BEGIN_NS + 355_000_000, 7))
    (point,) = bench.points
    assert point.compensation == "pretouch"
    towards = (np.array(point.surface_mm) - point.xyz_mm) / 3.0
    # It continues in the direction of its approach.
    later_mm = (
        bench.measurement.trajectory.position_mm(BEGIN_NS + 375_000_000) - point.xyz_mm
    )
    assert towards @ later_mm / np.linalg.norm(later_mm) > 0.9


async def test_a_press_in_the_air_waits_for_its_readings_and_takes_no_point(
    make_bench,
):
    air = InputSection(source="handle/0", trigger="button", double="air")
    bench = make_bench("pretouch", inputs=(air,), double_s=0.05)
    stream(bench, 0, 20)
    for token, ms in enumerate((200, 205, 215, 220)):
        at_ns = BEGIN_NS + ms * 1_000_000
        bench.take(edge("handle", at_ns, token, active=token % 2 == 0))
    assert bench.acknowledged("handle") == []
    stream(bench, 20, 60)
    assert bench.acknowledged("handle") == [0, 1, 2, 3]
    assert bench.points == []
    bench.take(edge("base", BEGIN_NS + 555_000_000, 0, counts=(1, 2, 3)))
    (point,) = bench.points
    there_mm = bench.measurement.trajectory.position_mm(BEGIN_NS + 200_000_000)
    away_mm = np.array(point.xyz_mm) - there_mm
    towards = (np.array(point.surface_mm) - point.xyz_mm) / 3.0
    assert towards == pytest.approx(away_mm / np.linalg.norm(away_mm), abs=1e-3)

"""Scans by distance, at planes, while held, and through filters: in the scanner."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.daemon.values import PoseMaker, SetClock, arm_model
from traverse.daemon.config.filters import FilterSection, removed_counters
from traverse.daemon.config.schema import ScanSection
from traverse.daemon.pose.alignment import ActiveAlignment, Alignment
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.scans.scanner import Scanner
from traverse.kinematics.filters import FILTERS, FilterChain, PointBlock
from traverse.protocol.messages import QualityFlag

PERIOD_NS = 1_000_000
BUTTON = ("base", 0)
BEGIN_NS = 10**12


class Bench:
    def __init__(self, model, path_mm, *, filters=(), wait_s=0.02, **plan) -> None:
        self.model, self.path_mm = model, np.asarray(path_mm, dtype=float)
        self.messages = []
        self.part = ActiveAlignment()
        section = ScanSection(
            held_wait_s=wait_s,
            filters=tuple(FilterSection.from_table(table) for table in filters),
        )
        self.scanner = Scanner(SetClock(), self.offer, 0.01, section, self.part)
        self.poses = PoseMaker(model, PERIOD_NS, BEGIN_NS)
        self.scanner.start(ScanPlan("s1", 1000.0, 1, **plan), model, "session-1")
        self.scanner.follow(1, 1000.0)

    def offer(self, message, on_dropped):
        self.messages.append(message)
        return True

    def take(self, seq, *, stream=1):
        self.scanner.take(self.model, self.block(seq, stream=stream))

    def block(self, seq, *, stream=1):
        block = self.poses.block(seq, stream=stream)
        block.xyz_mm[:] = self.path_mm[block.seq]
        return block

    def ended(self):
        self.scanner.stop()
        return self.messages

    @property
    def xyz_mm(self):
        return np.concatenate([m.xyz_mm for m in self.messages])

    @property
    def numbers(self):
        return [m.seq + k for m in self.messages for k in range(len(m.xyz_mm))]

    @property
    def instants(self):
        times_ns = np.concatenate([m.time_ns + m.dtime_ns for m in self.messages])
        return ((times_ns - SetClock().to_utc_ns(BEGIN_NS)) / PERIOD_NS).tolist()


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


def line(n, step_mm=0.1):
    return np.outer(np.arange(n), [step_mm, 0.0, 0.0])


def test_by_distance_a_point_comes_each_time_the_probe_has_gone_so_far(model):
    bench = Bench(model, line(101, 0.125), mode="distance", spacing_mm=1.0)
    for first in range(0, 100, 7):
        bench.take(range(first, min(first + 7, 101)))
    last = bench.ended()[-1]
    assert bench.xyz_mm[:, 0].tolist() == [float(k) for k in range(13)]
    assert bench.numbers == list(range(13))
    assert (last.mode, last.rate_hz, last.lost, last.total) == ("distance", None, 0, 13)


def test_at_rest_a_scan_by_distance_has_one_point(model):
    bench = Bench(model, np.zeros((50, 3)), mode="distance", spacing_mm=0.5)
    bench.take(range(50))
    bench.ended()
    assert bench.numbers == [0]


def test_at_planes_points_lie_on_them_and_say_that_they_are_interpolated(model):
    path_mm = np.outer(np.arange(60), [0.1, 0.13, -0.02])
    planes = {"mode": "planes", "spacing_mm": 2.0, "normal": (0.0, 2.0, 0.0)}
    bench = Bench(model, path_mm, offset_mm=0.5, **planes)
    bench.take(range(11))
    bench.take(range(11, 60))
    messages = bench.ended()
    assert bench.xyz_mm[:, 1] == pytest.approx([0.5, 2.5, 4.5, 6.5], abs=1e-12)
    assert bench.xyz_mm[:, 0] == pytest.approx(bench.xyz_mm[:, 1] / 1.3, abs=1e-12)
    assert bench.numbers == [0, 1, 2, 3]
    quality = np.concatenate([m.quality for m in messages])
    assert (quality == QualityFlag.INTERPOLATED).all()
    assert bench.instants == pytest.approx([y / 0.13 for y in (0.5, 2.5, 4.5, 6.5)])


def test_a_held_scan_has_what_was_measured_from_the_press_to_the_release(model):
    bench = Bench(model, line(100), held=True)
    bench.take(range(30))
    # The edges arrive late, each 10 ms after it happened.
    assert bench.scanner.edge(BUTTON, BEGIN_NS + 20 * PERIOD_NS, True) == 0.0
    bench.take(range(30, 60))
    assert bench.scanner.edge(BUTTON, BEGIN_NS + 50 * PERIOD_NS + 1, False) == 0.0
    bench.take(range(60, 100))
    last = bench.ended()[-1]
    assert bench.instants == list(range(20, 51))
    assert bench.numbers == list(range(31))
    assert (last.lost, last.total) == (0, 31)


def test_a_button_that_is_held_already_holds_the_scan_from_its_start(model):
    bench = Bench(model, line(40), held=True)
    bench.scanner.stop()
    bench.messages.clear()
    bench.scanner.edge(BUTTON, BEGIN_NS - 5, True)
    bench.scanner.start(ScanPlan("s2", 1000.0, 1, held=True), model, "session-1")
    bench.scanner.follow(1, 1000.0)
    bench.take(range(40))
    bench.ended()
    assert bench.instants == list(range(40))


def test_an_edge_that_is_told_too_late_is_noticed(model):
    bench = Bench(model, line(100), held=True)
    bench.take(range(60))
    late_s = bench.scanner.edge(BUTTON, BEGIN_NS + 10 * PERIOD_NS, True)
    assert late_s == pytest.approx(0.029, abs=1e-6)
    bench.take(range(60, 100))
    bench.ended()
    assert bench.instants == list(range(40, 100))  # what was not decided yet


def test_what_is_lost_while_no_button_is_held_leaves_no_gap(model):
    bench = Bench(model, line(100), held=True)
    bench.scanner.edge(BUTTON, BEGIN_NS + 20 * PERIOD_NS, True)
    bench.scanner.edge(BUTTON, BEGIN_NS + 60 * PERIOD_NS, False)
    bench.take([*range(5), *range(15, 30), *range(33, 58), *range(63, 100)])
    last = bench.ended()[-1]
    # Lost while held: 30 to 32, and 58, 59 of the gap 58 to 62.
    assert bench.instants == [*range(20, 30), *range(33, 58)]
    assert bench.numbers == [*range(10), *range(13, 38)]
    assert (last.lost, last.total) == (5, 40)


def test_nothing_is_interpolated_from_a_release_to_the_next_press(model):
    planes = {"mode": "planes", "spacing_mm": 1.0, "normal": (1.0, 0.0, 0.0)}
    bench = Bench(model, line(40) + np.full(3, 0.05), held=True, **planes)
    for press, release in ((0, 8), (12, 25)):  # crosses at 9.5, 19.5, 29.5
        bench.scanner.edge(BUTTON, BEGIN_NS + press * PERIOD_NS, True)
        bench.scanner.edge(BUTTON, BEGIN_NS + release * PERIOD_NS, False)
    bench.take(range(40))
    bench.ended()
    assert bench.instants == pytest.approx([19.5])


def test_lost_samples_leave_as_many_numbers_out_whatever_the_mode(model):
    bench = Bench(model, line(101, 0.125), mode="distance", spacing_mm=1.0)
    bench.take([*range(20), *range(25, 101)])
    last = bench.ended()[-1]
    assert bench.xyz_mm[:5, 0].tolist() == [0.0, 1.0, 2.0, 3.125, 4.125]
    assert bench.numbers == [0, 1, 2, *range(8, 18)]
    assert (last.lost, last.total) == (5, 18)


def test_filters_are_passed_in_their_order_and_counted(model):
    filters = [
        {"kind": "box", "low_mm": (1.0, -1.0, -1.0), "high_mm": (6.0, 1.0, 1.0)},
        {"kind": "distance", "spacing_mm": 1.0},
    ]
    bench = Bench(model, line(81, 0.125), filters=filters)
    bench.take(range(81))
    last = bench.ended()[-1]
    assert bench.xyz_mm[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert bench.numbers == list(range(6))
    assert (last.lost, last.total) == (0, 6)
    assert removed_counters(bench.scanner.chain) == {
        "scan_filter_1_box": 8 + 32,
        "scan_filter_2_distance": 41 - 6,
    }


def test_a_filter_starts_anew_with_each_scan(model):
    bench = Bench(model, line(20), filters=[{"kind": "grid", "spacing_mm": 100.0}])
    bench.take(range(20))
    bench.ended()
    bench.scanner.start(ScanPlan("s2", 1000.0, 1), model, "session-1")
    bench.scanner.follow(1, 1000.0)
    bench.take(range(20))
    bench.ended()
    assert [m.total for m in bench.messages if m.last] == [1, 1]


def test_flagged_points_are_held_back_by_name_of_the_flag(model):
    filters = [{"kind": "quality", "allowed": ("late", "interpolated")}]
    bench = Bench(model, line(6), filters=filters)
    block = bench.block(range(6))
    flags = [0, QualityFlag.LATE, QualityFlag.SKEW, QualityFlag.INTERPOLATED, 0, 1]
    block.quality[:] = flags
    bench.scanner.take(model, block)
    bench.ended()
    assert bench.instants == [0, 1, 3, 4]


def test_with_an_alignment_points_have_coordinates_of_the_part(model):
    bench = Bench(model, line(30))
    bench.take(range(5))
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    bench.part.alignment = Alignment("jig", turned, np.array([1.0, 2.0, 3.0]), 2.0)
    bench.take(range(5, 12))
    bench.part.alignment = None
    bench.take(range(12, 15))
    first, second, third = bench.ended()
    assert first.part_xyz_mm is None
    assert third.part_xyz_mm is None
    x = second.xyz_mm[:, 0]
    expected = np.column_stack([np.ones(7), 2.0 + 2.0 * x, np.full(7, 3.0)])
    assert second.part_xyz_mm == pytest.approx(expected, abs=1e-12)
    assert bench.numbers == list(range(15))


ALL_FILTERS = [
    {"kind": "box", "low_mm": (-9.0, -9.0, -9.0), "high_mm": (9.0, 9.0, 9.0)},
    {"kind": "sphere", "centre_mm": (0.0, 0.0, 0.0), "radius_mm": 9.0},
    {"kind": "slab", "normal": (0.0, 0.0, 1.0), "from_mm": -6.0, "to_mm": 6.0},
    {"kind": "speed", "max_mm_s": 2500.0},
    {"kind": "quality", "allowed": ("late",)},
    {"kind": "distance", "spacing_mm": 0.4},
    {"kind": "grid", "spacing_mm": 0.5},
    {"kind": "spacing", "spacing_mm": 0.5},
    {"kind": "sections", "normal": (1.0, 0.0, 0.0), "spacing_mm": 1.0},
]


def test_all_filters_are_tried_below():
    assert {table["kind"] for table in ALL_FILTERS} == set(FILTERS)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.permutations(ALL_FILTERS), st.integers(1, 5))
def test_daemon_and_off_line_filters_give_the_same_points(model, seed, tables, n):
    random = np.random.default_rng(seed)
    path_mm = np.cumsum(random.normal(0.0, 0.5, (400, 3)), axis=0)
    quality = random.choice([0, 0, 0, 1, QualityFlag.LATE], 400).astype(np.uint32)
    bench = Bench(model, path_mm, filters=tables[:n])
    cuts = np.unique([0, 400, *random.integers(1, 400, 10)]).tolist()
    for first, end in pairwise(cuts):
        block = bench.block(range(first, end))
        block.quality[:] = quality[first:end]
        bench.scanner.take(model, block)
    bench.ended()
    whole = bench.block(range(400))
    off_line = FilterChain(
        [FilterSection.from_table(table).create() for table in tables[:n]]
    ).apply(
        PointBlock(
            whole.seq,
            whole.sample_time_ns,
            whole.xyz_mm,
            whole.ijk,
            whole.angles_rad,
            whole.counts,
            quality,
            np.zeros((len(quality), 6)),
        )
    )
    assert (bench.xyz_mm == off_line.xyz_mm).all()
    assert bench.numbers == list(range(len(off_line)))

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.values import UTC_OFFSET_NS, PoseMaker, SetClock, arm_model
from traverse.daemon.scans.plan import ScanPlan, plan_scan
from traverse.daemon.scans.scanner import Scanner
from traverse.daemon.scans.selection import MAX_EDGES, ButtonGate
from traverse.protocol.messages.quality import flag_names

PERIOD_NS = 10_000_000  # a stream of 100 Hz


class Bench:
    def __init__(self, model, *, rate_hz=100.0, every=1, block_s=0.1) -> None:
        self.model = model
        self.messages = []
        self.room = True
        self.clock = SetClock()
        self.scanner = Scanner(self.clock, self.offer, block_s)
        self.poses = PoseMaker(model, PERIOD_NS)
        self.scanner.start(ScanPlan("s1", rate_hz, every), model, "session-1")
        self.scanner.follow(1, rate_hz * every)

    def offer(self, message, on_dropped):
        if self.room:
            self.messages.append(message)
        return self.room

    def take(self, seq, **options):
        self.scanner.take(self.model, self.poses.block(seq, **options))

    def numbers(self):
        return [
            (message.seq + k, int(x))
            for message in self.messages
            for k, x in enumerate(message.xyz_mm[:, 0])
        ]


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return arm_model(tmp_path_factory.mktemp("arm"))


def test_the_device_streams_at_least_at_the_tracking_rate():
    for rate_hz, every in ((1000.0, 1), (100.0, 1), (99.0, 2), (30.0, 4), (0.5, 200)):
        plan = plan_scan(rate_hz, 100.0)
        assert plan.every == every
        assert plan.device_rate_hz >= 100.0
        assert plan.device_rate_hz == rate_hz * every


@pytest.mark.parametrize("largest_hz", [99.8, 100.0, 100.02, 59.9, 60.003, 20.0, 10.0])
@pytest.mark.parametrize("share", [0.2, 0.25, 0.5, 0.9, 0.99, 1.0, 1.001, 1.04])
def test_a_slow_device_is_scanned_at_a_rate_near_the_requested(largest_hz, share):
    rate_hz = share * largest_hz
    plan = plan_scan(rate_hz, min(100.0, largest_hz), largest_hz)
    assert plan.device_rate_hz <= largest_hz * (1 + 1e-9)
    assert plan.rate_hz == pytest.approx(rate_hz, rel=0.05)
    # The joints are followed as well as the rate of the scan allows.
    assert plan.device_rate_hz > largest_hz / 2.0


@pytest.mark.parametrize(
    ("rate_hz", "every", "device_hz"),
    [
        (20.0, 1, 33.0),  # 2 x 20 Hz cannot be read
        (10.0, 1, 33.0),  # 3 x 10 Hz can, and is slower by a tenth
        (16.0, 2, 32.0),  # 2 x 16 Hz is about as quick
        (16.6, 2, 33.0),  # as is 2 x 16.5 Hz, which is a rate nearby
        (33.0, 1, 33.0),
    ],
)
def test_a_line_of_encoders_is_read_as_often_as_without_a_scan(
    rate_hz, every, device_hz
):
    plan = plan_scan(rate_hz, 33.0, 33.0, reads_in_turn=True)
    assert plan.every == every
    assert plan.device_rate_hz == pytest.approx(device_hz)
    assert plan.rate_hz == pytest.approx(rate_hz, rel=0.01)


def test_a_line_that_is_quick_enough_has_samples_at_the_instants_of_a_scan():
    plan = plan_scan(30.0, 100.0, 500.0, reads_in_turn=True)
    assert (plan.every, plan.device_rate_hz, plan.read_hz) == (4, 120.0, 0.0)


def test_a_scan_between_readings_keeps_its_rate_on_a_slower_stream(model):
    bench = Bench(model)
    plan = plan_scan(20.0, 33.0, 33.0, reads_in_turn=True)
    bench.scanner.start(plan, model, "session-1")
    assert bench.scanner.follow(1, 31.5, 33.0)
    assert bench.scanner.plan.rate_hz == 20.0
    assert bench.scanner.plan.device_rate_hz == 31.5
    assert bench.scanner.follow(2, 33.0)  # the line is found again, and is quicker


def test_a_scan_has_the_rate_that_the_device_states(model):
    bench = Bench(model, rate_hz=25.0, every=4)
    assert bench.scanner.follow(2, 99.8, 100.0)
    bench.take(range(8), stream=2)
    bench.scanner.stop()
    assert bench.messages[0].rate_hz == pytest.approx(24.95)
    assert not bench.scanner.follow(3, 99.8, 100.0)  # no scan runs any more


def test_points_that_wait_while_utc_is_set_are_marked(model):
    """A block has one UTC, which is that of after the step."""
    bench = Bench(model)
    bench.take(range(4))
    bench.clock.now_ns += 5 * PERIOD_NS
    bench.clock.offset_ns += 1_760_000_000
    bench.take(range(4, 10))
    bench.clock.now_ns += 5 * PERIOD_NS
    bench.take(range(10, 20))
    flags = [flag_names(int(bits)) for m in bench.messages for bits in m.quality]
    assert flags[:5] == [("time_uncertain",)] * 5
    assert flags[10:] == [()] * 10
    assert [message.in_doubt for message in bench.messages] == [
        flags.count(flags[0])
    ] * 2


def test_points_are_numbered_from_the_start_and_handed_on_in_blocks(model):
    bench = Bench(model)
    for first in range(0, 20, 4):
        bench.take(range(first, first + 4))
    assert [len(m.xyz_mm) for m in bench.messages] == [12]  # 10 make a block of 0.1 s
    assert bench.scanner.stop() == 20
    assert bench.numbers() == [(k, k) for k in range(20)]
    first, last = bench.messages
    assert (first.scan, first.session, first.rate_hz) == ("s1", "session-1", 100.0)
    assert first.time_ns == UTC_OFFSET_NS + 10**12
    assert first.dtime_ns.tolist() == [k * PERIOD_NS for k in range(12)]
    assert last.time_ns == UTC_OFFSET_NS + 10**12 + 12 * PERIOD_NS
    assert (first.last, first.total) == (False, None)
    assert (last.last, last.total, last.lost, last.dropped) == (True, 20, 0, 0)
    assert bench.scanner.published_points == 20


@pytest.mark.parametrize("unknown", [[], [2], [0, 1], [0, 1, 2, 3]])
def test_points_state_their_covariances_beside_others_that_have_none(model, unknown):
    bench = Bench(model, rate_hz=50.0, every=2)
    poses = bench.poses.block(range(8))
    covariances_mm2 = np.arange(48.0).reshape(8, 6)
    covariances_mm2[2 * np.array(unknown, np.int64)] = np.nan
    bench.scanner.take(model, poses, covariances_mm2)
    bench.scanner.stop()
    stated = {}
    for message in bench.messages:
        for row in range(len(message.xyz_mm)):
            known = message.covariance_mm2
            stated[message.seq + row] = None if known is None else known[row].tolist()
    assert stated == {
        k: None if k in unknown else covariances_mm2[2 * k].tolist() for k in range(4)
    }
    assert [message.last for message in bench.messages].count(True) == 1


def test_a_slow_scan_takes_every_so_many_th_sample(model):
    bench = Bench(model, rate_hz=25.0, every=4)
    bench.take(range(6))
    bench.take(range(6, 7))  # nothing of it
    bench.take(range(7, 17))
    assert bench.scanner.stop() == 5
    assert bench.numbers() == [(0, 0), (1, 4), (2, 8), (3, 12), (4, 16)]


def test_a_gap_on_the_line_begins_a_new_message_and_is_counted(model):
    bench = Bench(model)
    bench.take([0, 1, 2, 5, 6, 9])
    assert bench.scanner.stop() == 10
    assert [(m.seq, len(m.xyz_mm)) for m in bench.messages] == [(0, 3), (5, 2), (9, 1)]
    assert [m.lost for m in bench.messages] == [0, 2, 4]
    assert [m.last for m in bench.messages] == [False, False, True]


def test_samples_lost_at_the_beginning_are_counted(model):
    bench = Bench(model)
    bench.take([3, 4])
    bench.scanner.stop()
    assert [(m.seq, m.lost) for m in bench.messages] == [(3, 3)]


@pytest.mark.parametrize("every", [1, 4])
def test_an_outage_leaves_a_gap_as_long_as_it_lasted(model, every):
    bench = Bench(model, rate_hz=100.0 / every, every=every)
    bench.take(range(0, 8 * every))
    bench.scanner.follow(2, 100.0)  # the device is back after 50 instants
    bench.take(range(0, 2 * every), stream=2, at=58 * every)
    bench.take(range(2 * every, 4 * every), stream=2, at=60 * every)
    assert bench.scanner.stop() == 62
    assert [number for number, _ in bench.numbers()] == [*range(8), *range(58, 62)]
    assert bench.messages[-1].lost == 50


def test_samples_of_another_stream_are_no_points(model):
    bench = Bench(model)
    bench.take(range(3), stream=7)
    assert not bench.scanner.follow(8, 250.0)  # not the scan's rate
    bench.take(range(3), stream=8)
    assert bench.scanner.stop() == 0
    (end,) = bench.messages
    assert (end.last, end.total, len(end.xyz_mm)) == (True, 0, 0)


def test_dropped_blocks_are_counted_and_leave_a_gap(model):
    bench = Bench(model)
    bench.take(range(10))
    bench.room = False
    bench.take(range(10, 20))
    bench.room = True
    bench.take(range(20, 30))
    assert bench.scanner.stop() == 30
    assert [m.seq for m in bench.messages] == [0, 20, 30]
    assert [m.dropped for m in bench.messages] == [0, 10, 10]
    assert [m.lost for m in bench.messages] == [0, 0, 0]
    assert bench.messages[-1].total == 30
    assert bench.scanner.dropped_points == 10
    assert bench.scanner.published_points == 20


def test_a_new_model_begins_a_new_message(model):
    bench = Bench(model)
    bench.take(range(3))
    bench.model = replace(model, digest="another")
    bench.take(range(3, 5))
    bench.scanner.stop()
    assert [(m.seq, m.model) for m in bench.messages] == [
        (0, model.digest),
        (3, "another"),
    ]


def test_stopping_without_a_scan_says_nothing(model):
    bench = Bench(model)
    bench.scanner.stop()
    bench.messages.clear()
    assert bench.scanner.stop() == 0
    bench.take(range(5))
    assert not bench.scanner.follow(3, 100.0)
    assert bench.messages == []


def test_times_within_a_message_never_decrease(model):
    bench = Bench(model)
    block = bench.poses.block(range(5))
    times_ns = block.sample_time_ns.copy()
    times_ns[3] = times_ns[1]
    bench.scanner.take(model, replace(block, sample_time_ns=times_ns))
    bench.scanner.stop()
    assert (np.diff(bench.messages[0].dtime_ns) >= 0).all()


def test_a_stall_makes_several_messages_and_no_huge_one(model):
    bench = Bench(model)
    bench.take(range(2500))
    assert [len(message.xyz_mm) for message in bench.messages] == [1000, 1000, 500]
    assert bench.numbers() == [(k, k) for k in range(2500)]


BUTTON, OTHER = ("base", 0), ("handle", 3)


def held(gate, *times_ns):
    return gate.held(np.array(times_ns, dtype=np.int64)).tolist()


def test_the_instant_of_a_press_is_held_and_that_of_a_release_is_not():
    gate = ButtonGate()
    gate.edge(BUTTON, 100, True)
    gate.edge(BUTTON, 200, False)
    assert held(gate, 99, 100, 199, 200, 201) == [False, True, True, False, False]


def test_without_an_edge_nothing_is_held():
    assert held(ButtonGate(), 1, 2) == [False, False]


def test_any_of_several_buttons_holds():
    gate = ButtonGate()
    gate.edge(BUTTON, 10, True)
    gate.edge(OTHER, 15, True)
    gate.edge(BUTTON, 20, False)
    gate.edge(OTHER, 30, False)
    assert held(gate, 9, 12, 22, 29, 30) == [False, True, True, True, False]


def test_it_remembers_so_many_edges_and_no_more():
    gate = ButtonGate()
    for k in range(3 * MAX_EDGES):
        gate.edge(BUTTON, k, k % 2 == 0)
    last = 3 * MAX_EDGES - 1
    assert held(gate, last - 1, last) == [True, False]
    assert held(gate, 0) == [False]  # long forgotten


@given(
    st.lists(st.tuples(st.integers(0, 40), st.booleans()), unique_by=lambda e: e[0]),
    st.randoms(use_true_random=False),
)
def test_levels_are_those_of_the_last_edge_in_whatever_order_edges_come(edges, random):
    gate = ButtonGate()
    shuffled = list(edges)
    random.shuffle(shuffled)
    for time_ns, level in shuffled:
        gate.edge(BUTTON, time_ns, level)
    for time_ns in range(42):
        before = [level for at_ns, level in sorted(edges) if at_ns <= time_ns]
        assert held(gate, time_ns) == [before[-1] if before else False]

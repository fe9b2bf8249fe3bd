import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from traverse.drivers.timing.device_clock import WRAP, DeviceClock

MAX_LAG_NS = 500_000

RATE_HZ = 1_000_000


def followed(
    ppm: float,
    first_tick: int,
    seconds: float,
    largest_delay_ns: float,
    reads_hz: int = 500,
):
    rng = np.random.default_rng(3)
    clock = DeviceClock(RATE_HZ)
    true_rate = RATE_HZ * (1 + ppm * 1e-6)
    errors_ns = []
    host_ns = 10**12
    for k in range(int(reads_hz * seconds)):
        latch_ns = host_ns + 10**9 // reads_hz * k
        ticks = first_tick + round((latch_ns - host_ns) * true_rate * 1e-9)
        delay_ns = 100_000 + rng.uniform(0, largest_delay_ns)
        (unwrapped,) = clock.unwrap(np.array([ticks % WRAP], np.uint32)).tolist()
        assert unwrapped == ticks
        clock.update(unwrapped, int(latch_ns + delay_ns))
        errors_ns.append(clock.to_ns(unwrapped) - latch_ns - 100_000)
    return clock, np.array(errors_ns)


@pytest.mark.parametrize("jitter_ms", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("ppm", [10.0, -200.0, 200.0])
def test_jitter_and_rate_of_the_device_are_followed(ppm, jitter_ms):
    # The counter wraps on the way.
    clock, errors_ns = followed(ppm, WRAP - 15_000_000, 30.0, jitter_ms * 1e6, 100)
    settled = errors_ns[len(errors_ns) // 3 :]
    # 50 reads per half second: the smallest delay of each is a 50th of the largest on
    # average, and the line lies below the least of these.
    assert np.abs(settled).max() < 15_000 + 20_000 * jitter_ms
    assert abs(np.median(settled)) < 2_000 + 4_000 * jitter_ms
    second_ns = clock.to_ns(WRAP + RATE_HZ) - clock.to_ns(WRAP)
    assert 1e9 - second_ns == pytest.approx(1e3 * ppm, abs=1e3 * (0.5 + jitter_ms))
    assert clock.steps == 0


def test_a_host_that_is_busy_now_and_then_does_not_move_the_mapping():
    rng = np.random.default_rng(11)
    clock = DeviceClock(RATE_HZ)
    errors_ns = []
    for k in range(4_000):
        ticks = 10_000 * k
        is_busy = k // 100 % 10 == 3  # one second in ten
        delay_ns = rng.uniform(0, 1e6) + is_busy * rng.uniform(0, 2e7)
        clock.update(ticks, ticks * 1000 + int(delay_ns))
        errors_ns.append(clock.to_ns(ticks) - ticks * 1000)
    assert np.abs(errors_ns[1000:]).max() < 35_000


def test_the_counter_wraps_without_a_trace():
    clock, errors_ns = followed(20.0, WRAP - 5_000_000, 20.0, 1e6)
    assert np.abs(errors_ns[2500:]).max() < 30_000
    assert clock.steps == 0


def test_mapped_times_never_run_backwards():
    clock = DeviceClock(RATE_HZ)
    rng = np.random.default_rng(5)
    last_ns = 0
    for k in range(20_000):
        ticks = k * 1000
        clock.update(ticks, int(ticks * 1000 * 1.0002 + rng.uniform(0, 3e6)))
        mapped = clock.to_ns_array(np.arange(ticks - 900, ticks + 1, 100))
        assert (np.diff(mapped) > 0).all()
        assert mapped[0] > last_ns
        last_ns = int(mapped[-1])


def test_a_late_edge_is_mapped_to_its_own_time():
    clock, _ = followed(0.0, 0, 10.0, 1000)
    now = 10 * RATE_HZ - 2000
    late = clock.unwrap(np.array([now - 300_000], np.uint32))
    assert late.tolist() == [now - 300_000]
    assert clock.to_ns(now) - clock.to_ns(now - 300_000) == pytest.approx(3e8, abs=2e4)


def test_a_counter_that_jumps_ahead_starts_the_mapping_afresh():
    clock, _ = followed(0.0, 0, 5.0, 1000)
    jumped = 5 * RATE_HZ + 10 * RATE_HZ
    received_ns = 10**12 + 5 * 10**9
    clock.update(jumped, received_ns)
    assert clock.steps == 1
    assert abs(clock.to_ns(jumped) - received_ns) < 1000


def test_a_short_counter_wraps_without_a_trace():
    # 14 bits of milliseconds, as a MicroScribe has them: 16.4 s.
    clock = DeviceClock(1000.0, 1 << 14)
    rng = np.random.default_rng(7)
    for k in range(4_000):
        latch_ms = 9.3 * k
        (ticks,) = clock.unwrap(np.array([int(latch_ms) % 16384], np.uint32)).tolist()
        assert ticks == int(latch_ms)
        clock.update(ticks, int(latch_ms * 1e6 + rng.uniform(0, 3e6)))
    # A tick is timed at its begin: half a tick and the smallest delays remain.
    assert abs(clock.to_ns(ticks) - latch_ms * 1e6) < 1.1e6
    assert clock.steps == 0


def test_one_latch_has_the_time_of_a_block():
    clock, _ = followed(-35.0, WRAP - 3_000_000, 12.0, 3e6)
    base = clock.unwrap(np.array([0], np.uint32))[0]
    rng = np.random.default_rng(8)
    for ticks in (base + rng.integers(-2_000_000, 2_000_000, 200)).tolist():
        assert clock.unwrap_one(ticks % WRAP) == ticks
        assert clock.unwrap(np.array([ticks % WRAP], np.uint32)).tolist() == [ticks]
        assert clock.to_ns(ticks) == clock.to_ns_array(np.array([ticks]))[0]


def test_a_first_latch_alone_counts_from_itself():
    assert DeviceClock(RATE_HZ).unwrap_one(4_000_000_000) == 4_000_000_000


PERIOD_NS = 20_000_000
STALLS = st.lists(st.tuples(st.floats(0.0, 8.0), st.floats(0.05, 2.0)), max_size=4)


def worst_while_certain_ns(stalls: list[tuple[float, float]]) -> float:
    """Error of an untied clock whose host stands still now and then [s, s].

    A device sends every 20 ms; the bytes of a while are read at one time.
    """
    clock, worst_ns = DeviceClock(RATE_HZ), 0.0
    for k in range(550):
        read_ns = sent_ns = k * PERIOD_NS
        for begin_s, length_s in sorted(stalls):
            if begin_s * 1e9 <= read_ns < (begin_s + length_s) * 1e9:
                read_ns = int((begin_s + length_s) * 1e9)
        clock.update(sent_ns // 1000, read_ns + 100_000)
        if not clock.is_uncertain:
            worst_ns = max(worst_ns, abs(clock.to_ns(sent_ns // 1000) - sent_ns))
    assert not clock.is_uncertain
    return worst_ns


@example([(1.0, 1.5)])  # soon after connecting: edges had been late by a second
@example([(0.0, 0.519)])
@given(STALLS)
def test_times_after_reads_of_a_host_that_stood_still_are_uncertain(stalls):
    """The last read at the end of a standstill may be a period old, no more."""
    assert worst_while_certain_ns(stalls) < PERIOD_NS + MAX_LAG_NS + 200_000


@pytest.mark.parametrize("stall", [(0.0, 0.4), (1.0, 1.5), (5.0, 3.0)])
def test_a_host_that_stands_still_moves_no_clock(stall):
    assert worst_while_certain_ns([stall]) < MAX_LAG_NS + 200_000


def test_a_first_half_second_that_was_late_all_along_makes_no_time_certain():
    """Until two others agree: one alone looks like an undisturbed one."""
    clock, certain_from = DeviceClock(RATE_HZ), None
    for k in range(200):
        sent_ns = k * PERIOD_NS
        late_ns = 15_000_000 if sent_ns < 600_000_000 else 100_000
        clock.update(sent_ns // 1000, sent_ns + late_ns)
        if not clock.is_uncertain:
            certain_from = certain_from or sent_ns
            assert abs(clock.to_ns(sent_ns // 1000) - sent_ns) < MAX_LAG_NS + 200_000
    assert certain_from is not None
    assert certain_from < 2.1e9


@pytest.mark.parametrize(
    ("away_s", "lost_s", "continues"),
    [
        (0.5, 0.0, True),
        (3600.0, 0.0, True),
        (10_000.0, 0.0, True),  # the counter has wrapped twice meanwhile
        (10.0, -3.0, True),  # the computer slept
        (10.0, 1.0, True),
        (10.0, 20.0, False),
        (0.5, 1000.0, False),
    ],
)
def test_a_counter_that_begins_anew_is_not_the_one_of_before(away_s, lost_s, continues):
    rate_hz, wrap = 1_000_000, 1 << 32
    before = DeviceClock(rate_hz)
    for k in range(2000):
        ticks = 30 * rate_hz + k * rate_hz // 100
        before.update(before.unwrap_one(ticks % wrap), 10**12 + k * 10**7)
    at_s = 20.0 + away_s
    counted = round((30.0 + at_s - lost_s) * rate_hz) % wrap
    at_ns = 10**12 + round(at_s * 1e9)
    assert before.is_continued_by(counted, at_ns) == continues

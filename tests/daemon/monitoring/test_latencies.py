"""Percentiles and histogram of latencies, against counting by hand."""

import gc
import sys
import threading

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from traverse.daemon.monitoring.latencies import KEPT, Latencies, timed_collections
from traverse.protocol.messages.health import LATENCY_BOUNDS_US


def test_percentiles_are_those_of_the_definition():
    latencies = Latencies()
    assert latencies.figures() is None
    for k in range(1, 102):
        latencies.add(k * 1000)
    figures = latencies.figures()
    values = (figures.p50_us, figures.p99_us, figures.max_us, figures.n)
    assert values == (51.0, 100.0, 101.0, 101)
    latencies.clear()
    assert latencies.figures() is None


def test_of_very_many_the_largest_and_all_counts_are_kept():
    latencies = Latencies()
    latencies.add(10**9)
    for _ in range(KEPT):
        latencies.add(1000)
    figures = latencies.figures()
    assert (figures.p50_us, figures.p99_us) == (1.0, 1.0)
    assert (figures.max_us, figures.n) == (1e6, KEPT + 1)
    assert figures.histogram[0] == KEPT


def test_a_value_on_a_bound_belongs_to_the_bin_below():
    latencies = Latencies()
    latencies.add(10_000)
    latencies.add(10_001)
    assert latencies.figures().histogram[:3] == (1, 1, 0)


def test_the_bounds_are_one_two_and_five_of_six_decades():
    assert LATENCY_BOUNDS_US[:4] == (10, 20, 50, 100)
    assert LATENCY_BOUNDS_US[-1] == 5_000_000


@given(st.lists(st.integers(0, 20_000_000_000), min_size=1, max_size=200))
def test_histograms_are_those_of_numpy_and_continue_when_cleared(durations_ns):
    latencies = Latencies()
    for _ in range(2):
        for duration_ns in durations_ns:
            latencies.add(duration_ns)
        below = [
            int(np.sum(np.array(durations_ns) <= bound * 1000))
            for bound in LATENCY_BOUNDS_US
        ]
        counts = np.diff([0, *below, len(durations_ns)])
        assert latencies.figures().histogram == tuple(counts)
        latencies.clear()
    assert latencies.total_counts == list(2 * counts)
    assert latencies.total_ns == 2 * sum(durations_ns)


def test_another_thread_that_notes_times_meanwhile_does_no_harm():
    """The garbage collector runs, and notes its time, in whatever thread needs it."""
    latencies, end = Latencies(), threading.Event()

    def note():
        while not end.is_set():
            latencies.add(1000)

    thread = threading.Thread(target=note)
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    thread.start()
    try:
        for n in range(500):
            latencies.figures()
            if n % 50 == 0:
                latencies.clear()
    finally:
        end.set()
        thread.join()
        sys.setswitchinterval(before_s)
    assert latencies.total_ns >= 1000


def test_garbage_collections_are_timed_while_the_block_lasts():
    callbacks = list(gc.callbacks)
    pauses = Latencies()
    with timed_collections(pauses):
        gc.collect()
    n = pauses.figures().n
    assert n >= 1
    assert pauses.total_ns > 0
    gc.collect()
    assert pauses.figures().n == n
    assert gc.callbacks == callbacks

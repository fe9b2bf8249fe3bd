"""Instants of a scan between the samples of a stream: by hand."""

import numpy as np

from traverse.daemon.scans.between import ScanInstants

BEGIN_NS = 10**12
MS = 1_000_000


def due(instants, stream, seq, times_ms):
    times_ns = BEGIN_NS + MS * np.array(times_ms)
    numbers, at_ns = instants.until(stream, np.array(seq), times_ns)
    return list(zip(numbers.tolist(), ((at_ns - BEGIN_NS) / MS).tolist(), strict=True))


def test_they_are_equal_steps_from_the_first_sample_on():
    instants = ScanInstants(20.0)
    assert due(instants, 1, [0, 1, 2], [0, 30, 60]) == [(0, 0), (1, 50)]
    assert due(instants, 1, [3], [90]) == []
    assert due(instants, 1, [4, 5], [120, 150]) == [(2, 100), (3, 150)]
    assert due(instants, 1, [6], [180]) == []


def test_those_beside_a_lost_sample_are_lost():
    instants = ScanInstants(20.0)
    due(instants, 1, [0, 1, 2], [0, 30, 60])
    assert due(instants, 1, [4, 5, 6], [120, 150, 180]) == [(3, 150)]
    # A sample at the very instant needs no other.
    assert due(instants, 1, [8, 9], [250, 270]) == [(5, 250)]


def test_those_between_two_streams_are_lost_and_the_steps_stay_the_same():
    instants = ScanInstants(20.0)
    due(instants, 1, [0, 1, 2], [0, 30, 60])
    assert due(instants, 2, [0, 1, 2], [390, 420, 450]) == [(8, 400), (9, 450)]


def test_a_rate_that_is_no_whole_number_of_nanoseconds_does_not_drift():
    instants = ScanInstants(30.0)
    found = due(instants, 1, range(3000), 10 * np.arange(3000))
    assert len(found) == 900  # of 29.99 s
    assert found[-1] == (899, 29_966.666667)

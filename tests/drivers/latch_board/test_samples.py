"""Samples received in several reads are timed by all of them."""

from collections import Counter

import numpy as np

from traverse.drivers.latch_board.edge_sequence import EdgeSequencer
from traverse.drivers.latch_board.session import LatchBoardSession
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol.latch_board.messages import SampleBlock

BEGUN_NS = 5_000_000_000
MS_NS = 1_000_000


def test_the_read_with_the_smallest_delay_tells_the_time_of_all():
    taken = []
    session = LatchBoardSession(
        "base",
        "port",
        EdgeSequencer(),
        clock=DeviceClock(1_000_000),
        n_channels=2,
        put=taken.append,
        fault=print,
        counters=Counter(),
    )
    session.begin_stream(1, 7)
    ticks = np.array([0, 1000, 2000], np.uint32)  # a millisecond apart
    block = SampleBlock(
        7,
        np.arange(3, dtype=np.uint32),
        ticks,
        np.zeros(3, np.uint8),
        np.zeros((3, 2), np.uint32),
        np.zeros((3, 2), np.uint8),
    )
    late_ns = [300_000, 50_000, 900_000]
    first, second, last = (BEGUN_NS + k * MS_NS + late_ns[k] for k in range(3))
    session.take(block, last, [(0, first), (1, second)])
    [delivered] = taken
    assert delivered.received_ns == last
    error_ns = delivered.sample_time_ns - (BEGUN_NS + ticks.astype(np.int64) * 1000)
    # The mapping adapts to a smaller delay within half a second, not at once.
    assert error_ns[0] <= 300_000
    assert (np.diff(error_ns) <= 0).all()
    late = SampleBlock(
        7,
        np.array([3], np.uint32),
        np.array([1_000_000], np.uint32),
        np.zeros(1, np.uint8),
        np.zeros((1, 2), np.uint32),
        np.zeros((1, 2), np.uint8),
    )
    session.take(late, BEGUN_NS + 1000 * MS_NS + 900_000)
    assert taken[-1].sample_time_ns[0] == BEGUN_NS + 1000 * MS_NS + 50_000

"""Reads of a fast stream: samples are combined, an edge is never delayed by them.

Samples received in several reads are timed by all of them.
"""

from collections import Counter

import numpy as np
import pytest

from traverse.drivers.base.values import DeviceError
from traverse.drivers.latch_board.line import LatchBoardLine
from traverse.drivers.latch_board.sequences import EdgeSequencer
from traverse.drivers.latch_board.session import LatchBoardSession
from traverse.drivers.timing.device_clock import DeviceClock
from traverse.protocol.latch_board import messages as latch_board
from traverse.protocol.latch_board.messages import SampleBlock
from traverse.simulator.devices.latch_board import wire

COUNTS = np.arange(1, 8, dtype=np.uint32)
STATUS = np.zeros(7, np.uint8)
MS_NS = 1_000_000
BATCH_WINDOW_NS = 5_000_000
GONE = b"gone"  # in a script: the port is removed for good


class ScriptedPort:
    """Bytes that arrive at times of a clock which advances only in waits.

    Args:
        script: times in ns and the bytes received then; empty: a wake-up.
    """

    path = "scripted"

    def __init__(self, *script: tuple[int, bytes]) -> None:
        self._script = list(script)
        self.now_ns = 0

    def wait(self, seconds: float) -> bool:
        until_ns = self.now_ns + round(seconds * 1e9)
        if not self._script or self._script[0][0] > until_ns:
            self.now_ns = until_ns
            return False
        self.now_ns = max(self.now_ns, self._script[0][0])
        if not self._script[0][1]:
            self._script.pop(0)
            return False
        return True

    def read(self) -> bytes:
        if self._script and self._script[0][1] == GONE:
            raise DeviceError("gone", "plug it in")
        data = b""
        while self._script and self._script[0][0] <= self.now_ns:
            data += self._script.pop(0)[1]
        return data


def sample(seq: int) -> bytes:
    return b"".join(
        wire.samples(
            0,
            1,
            0,
            seqs=np.array([seq], np.uint32),
            ticks=np.array([seq], np.uint32),
            counts=COUNTS[np.newaxis],
            status=STATUS[np.newaxis],
        )
    )


def edge() -> bytes:
    return wire.edge(0, 1, 1, seq=0, ticks=3, counts=COUNTS, status=STATUS)


def heartbeat() -> bytes:
    return wire.heartbeat(
        1,
        0,
        3,
        edges_back=0,
        next_sample_seq=2,
        next_edge_seq=0,
        tx_dropped=0,
        rx_rejected=0,
    )


def dispatched(*script: tuple[int, bytes]) -> list[tuple]:
    """Return the dispatched ones: message, time, its bytes from earlier reads."""
    port = ScriptedPort(*script)
    dispatched_calls: list[tuple] = []
    line = LatchBoardLine(
        port,
        lambda: port.now_ns,
        lambda *arguments: dispatched_calls.append(arguments),
        lambda: False,
    )
    while port.wait(0.1):
        line.read(port.now_ns + BATCH_WINDOW_NS)
    return dispatched_calls


def reads(*script: tuple[int, bytes]) -> list[tuple[int, str]]:
    return [
        (at_ns, type(message).__name__) for message, at_ns, _ in dispatched(*script)
    ]


def test_samples_come_together_for_the_time_that_is_given():
    stream = [(n * MS_NS, sample(n)) for n in range(1, 9)]
    blocks = reads(*stream)
    assert blocks == [(6 * MS_NS, "SampleBlock"), (8 * MS_NS, "SampleBlock")]


def test_an_edge_is_taken_up_when_it_comes_with_the_samples_before_it():
    script = [(MS_NS, sample(1)), (2 * MS_NS, sample(2)), (2_300_000, edge())]
    assert reads(*script) == [(2_300_000, "SampleBlock"), (2_300_000, "Edge")]


def test_an_edge_in_pieces_is_taken_up_when_it_is_whole():
    frame = edge()
    for cut in range(1, len(frame)):
        script = [
            (MS_NS, sample(1) + frame[:cut]),
            (2 * MS_NS, frame[cut:]),
            (3 * MS_NS, sample(2)),
        ]
        assert reads(*script)[1] == (2 * MS_NS, "Edge")


def test_an_edge_begun_in_the_read_before_is_taken_up_when_it_is_whole():
    frame = edge()
    for cut in range(1, len(frame)):
        script = [
            (MS_NS, sample(1)),
            (6 * MS_NS, frame[:cut]),
            (8 * MS_NS, frame[cut:]),
        ]
        assert (8 * MS_NS, "Edge") in reads(*script)


def test_the_time_of_a_heartbeat_is_when_it_came():
    script = [(MS_NS, sample(1)), (2 * MS_NS, heartbeat()), (3 * MS_NS, sample(2))]
    assert (2 * MS_NS, "Heartbeat") in reads(*script)


def test_samples_that_hold_the_type_of_an_edge_are_no_edges():
    seqs = [latch_board.EDGE, latch_board.EDGE << 8, latch_board.EDGE << 16]
    stream = [((n + 1) * MS_NS, sample(seq)) for n, seq in enumerate(seqs)]
    assert reads(*stream) == [(3 * MS_NS, "SampleBlock")]


def test_a_wake_up_ends_the_gathering():
    script = [(MS_NS, sample(1)), (2 * MS_NS, b""), (3 * MS_NS, sample(2))]
    assert reads(*script) == [(MS_NS, "SampleBlock"), (3 * MS_NS, "SampleBlock")]


def test_while_samples_are_gathered_acknowledgements_go_out():
    """They are due 2 ms after each other, and end no batch."""
    port = ScriptedPort(*((n * 4 * MS_NS, sample(n)) for n in range(1, 4)))
    called_ns: list[int] = []
    blocks: list[int] = []

    def meanwhile() -> int:
        called_ns.append(port.now_ns)
        return port.now_ns + 2 * MS_NS

    line = LatchBoardLine(
        port, lambda: port.now_ns, lambda block, *_: blocks.append(len(block.seq)), bool
    )
    assert port.wait(0.1)
    line.read(port.now_ns + 2 * BATCH_WINDOW_NS, meanwhile)
    assert blocks == [3]
    assert called_ns == [4 * MS_NS, 6 * MS_NS, 8 * MS_NS, 10 * MS_NS, 12 * MS_NS]


def test_a_flood_is_taken_up_before_the_time_is_over():
    flood = b"".join(sample(seq) for seq in range(400))
    script = [(MS_NS, flood), (2 * MS_NS, sample(400))]
    assert reads(*script)[0] == (MS_NS, "SampleBlock")


def test_each_read_tells_when_its_last_sample_came():
    third = sample(3)
    script = [
        (MS_NS, sample(1)),
        (2 * MS_NS, sample(2) + third[:5]),
        (3 * MS_NS, third[5:9]),
        (4 * MS_NS, third[9:] + sample(4)),
    ]
    [(block, at_ns, earlier)] = dispatched(*script)
    assert block.seq.tolist() == [1, 2, 3, 4]
    assert at_ns == 4 * MS_NS
    assert list(earlier) == [(0, MS_NS), (1, 2 * MS_NS)]


def test_where_a_frame_is_broken_nobody_can_say_which_sample_came_when():
    broken = bytearray(sample(2))
    broken[9] ^= 0x40
    script = [(MS_NS, sample(1)), (2 * MS_NS, bytes(broken)), (3 * MS_NS, sample(3))]
    [(block, at_ns, earlier)] = dispatched(*script)
    assert block.seq.tolist() == [1, 3]
    assert (at_ns, list(earlier)) == (3 * MS_NS, [])


def test_what_earlier_reads_brought_is_of_the_samples_alone():
    script = [(MS_NS, sample(1)), (2 * MS_NS, sample(2) + edge())]
    (_, _, of_samples), (_, _, of_edge) = dispatched(*script)
    assert list(of_samples) == [(0, MS_NS)]
    assert list(of_edge) == []


def test_samples_before_the_port_went_away_are_taken_up_first():
    port = ScriptedPort((MS_NS, sample(1)), (2 * MS_NS, sample(2)), (3 * MS_NS, GONE))
    dispatched_calls = []
    line = LatchBoardLine(
        port,
        lambda: port.now_ns,
        lambda *arguments: dispatched_calls.append(arguments),
        lambda: False,
    )
    assert line.port.wait(0.1)
    line.read(port.now_ns + BATCH_WINDOW_NS)
    [(block, at_ns, _)] = dispatched_calls
    assert (block.seq.tolist(), at_ns) == ([1, 2], 2 * MS_NS)
    assert line.port.wait(0.1)
    with pytest.raises(DeviceError):
        line.read(port.now_ns + BATCH_WINDOW_NS)


BEGUN_NS = 5_000_000_000


def test_the_read_with_the_smallest_delay_tells_the_time_of_all():
    deliveries = []
    session = LatchBoardSession(
        "base",
        "port",
        EdgeSequencer(),
        clock=DeviceClock(1_000_000),
        n_channels=2,
        debounce_ns=0,
        put=deliveries.append,
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
    [delivered] = deliveries
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
    assert deliveries[-1].sample_time_ns[0] == BEGUN_NS + 1000 * MS_NS + 50_000

import contextlib
import os
import select
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from tests.drivers.simulated_peer import SimulatedPeer
from tests.simulator.one_hinge import mounted
from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    CountSamples,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    RepeatedCount,
    StreamStarted,
)
from traverse.drivers.text_line.driver import TextLineDriver
from traverse.simulator.devices.text_line import SimulatedTextLine, TextLineTable
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import (
    DriverContract,
    EdgeContract,
    StreamContract,
    streaming,
)
from traverse.testing.pty_peer import PeerRig, PtyPeer, rig_fixture
from traverse.testing.waiting import until

PERIOD_MS = 5
PATTERN = "$TRV,{seq},{time},{joint},{joint},{buttons}*{checksum}"
OPTIONS = {
    "pattern": PATTERN,
    "counts_per_turn": (65_536, 65_536),
    "checksum": "xor",
    "debounce_ms": 0,
}


def line(seq, ms, counts, buttons, end=b"\r\n"):
    body = f"TRV,{seq},{ms},{counts[0]},{counts[1]},{buttons}".encode()
    check = 0
    for byte in body:
        check ^= byte
    return b"$%s*%02X%s" % (body, check, end)


class FakeBoard(PtyPeer):
    """Prints a line every 5 ms of its own time, whenever it runs late after that.

    Attributes:
        spoil: how the next lines are printed instead; each is used once.
        n_lost: number of next lines that are not printed.
        time_of: what it prints as its time, of its milliseconds.
        period_ms: of its time, between two lines.
    """

    def __init__(self, link):
        super().__init__(link)
        self.seq, self.buttons, self.n_lost = 0, 0, 0
        self.begun_s = time.monotonic()
        self.spoil = []
        self.lock = threading.Lock()
        self.printed = 0
        self.reset = False
        self.time_of = lambda ms: ms
        self.period_ms, self.due_ms = PERIOD_MS, 0

    def _live(self):
        while self._plugged:
            with self.lock:
                if self.reset:
                    self.reset, self.seq, self.due_ms = False, 0, 0
                    self.begun_s = time.monotonic()
                ms = int((time.monotonic() - self.begun_s) * 1000)
                # Lines that are due; a late one has the time at which it was due.
                while self.due_ms <= ms:
                    self._print(self.due_ms)
                    self.due_ms += self.period_ms
            select.select([], [], [], 0.002)

    def _print(self, ms):
        seq = self.seq
        self.seq += 1
        if self.n_lost:
            self.n_lost -= 1
            return
        data = line(seq, self.time_of(ms), (seq % 65_536, 500), self.buttons)
        if self.spoil:
            data = self.spoil.pop(0)(data)
        self.printed += 1
        while data and self._plugged:  # a port that is full is waited for
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(self._master, data) :]
            if data:
                select.select([], [self._master], [], 0.01)


class BoardRig(PeerRig):
    def __init__(self, board, **options):
        super().__init__(board, TextLineDriver, **(OPTIONS | options))
        self.board = board

    def lose(self, n):
        with self.board.lock:
            self.board.n_lost = n

    def press(self):
        # Held for several lines: two have to show it.
        with self.board.lock:
            self.board.buttons ^= 1
            until_printed = self.board.printed + 4
        while self.board.printed < until_printed:
            time.sleep(0.002)


rig = rig_fixture(lambda folder: BoardRig(FakeBoard(folder / "board")))


class TestContract(DriverContract, StreamContract, EdgeContract):
    parts = (1, 7, 40)


async def test_odd_lines_cost_themselves_and_are_named(rig):
    with rig.driver:
        deliveries = await streaming(rig, 200.0)
        await deliveries.until(deliveries.seqs, "samples")
        with rig.board.lock:
            rig.board.spoil = [
                lambda data: data[: len(data) // 2] + b"\r\n",
                lambda data: data.replace(b"500", b"501"),
                lambda data: data.replace(b"500", b"nan"),
                lambda data: data.replace(b"\r\n", b""),  # merged with the next
                lambda data: data,
                lambda data: b"x" * 3000 + b"\n",
            ]
        await deliveries.until(
            lambda: (
                sum(
                    fault.count
                    for fault in deliveries.of(DeviceFault)
                    if fault.code == "frames_rejected"
                )
                >= 5
            ),
            "odd lines",
        )
        n = len(deliveries.seqs())
        await deliveries.until(
            lambda: len(deliveries.seqs()) > n + 5, "samples after them"
        )
    faults = [
        delivered
        for delivered in deliveries.of(DeviceFault)
        if delivered.code == "frames_rejected"
    ]
    assert sum(fault.count for fault in faults) == 5
    assert all("line" in fault.text and fault.remedy for fault in faults)
    for block in deliveries.of(CountSamples):
        assert set(block.counts[:, 1].tolist()) == {500}
    assert deliveries.of(DeviceLost) == []


async def test_a_board_that_begins_anew_is_a_restart(rig):
    with rig.driver:
        deliveries = await streaming(rig, 200.0)
        await deliveries.until(deliveries.seqs, "samples")
        await until(lambda: rig.board.seq > 300, "more than a second of its time")
        with rig.board.lock:
            rig.board.reset = True
        await deliveries.until(lambda: len(deliveries.of(DeviceUp)) == 2, "it is back")
    assert [ups.restarted for ups in deliveries.of(DeviceUp)] == [False, True]
    assert "reset" in deliveries.of(DeviceLost)[0].reason


@pytest.mark.parametrize("field", ["{seq},{time}", "{seq},{skip}", "{skip},{skip}"])
@pytest.mark.parametrize("period_ms", [40, 2])
async def test_a_board_that_prints_at_another_rate_is_followed(
    tmp_path, field, period_ms
):
    pattern = PATTERN.replace("{seq},{time}", field)
    with FakeBoard(tmp_path / "board") as board:
        rig = BoardRig(board, pattern=pattern)
        with rig.driver:
            deliveries = await streaming(rig, 200.0)
            await deliveries.until(deliveries.seqs, "samples")
            with board.lock:
                board.period_ms = period_ms
            await deliveries.until(
                lambda: len(deliveries.of(StreamStarted)) == 2, "the other rate"
            )
            await deliveries.until(
                lambda: deliveries.of(CountSamples)[-1].stream == 2, "samples of it"
            )
    texts = [f.text for f in deliveries.of(DeviceFault) if f.code == "rate_changed"]
    before, now = deliveries.of(StreamStarted)
    assert now.reached_hz == pytest.approx(1000.0 / period_ms, rel=0.1)
    assert before.reached_hz == pytest.approx(200.0, rel=0.1)
    assert len(texts) == 1
    assert deliveries.of(DeviceLost) == []


async def loss_of(board, **options):
    """The first loss of a board, and what remedies it."""
    rig = BoardRig(board, **options)
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "a loss")
    lost = deliveries.of(DeviceLost)[0]
    return lost.reason, lost.remedy


@pytest.mark.parametrize(
    ("unit", "per_ms", "ratio", "remedy"),
    [
        ("ms", 1000, "1000 times", 'time_unit = "us"'),
        ("us", 1, "0.001 times", 'time_unit = "ms"'),
        ("s", 1, "1000 times", 'time_unit = "ms"'),
        ("ms", 10, "10 times", "have the board print"),
        ("ms", 0.25, "0.25 times", "have the board print"),
        ("ms", 0, "does not advance", "millis()"),
    ],
)
async def test_a_time_in_another_unit_is_named(tmp_path, unit, per_ms, ratio, remedy):
    with FakeBoard(tmp_path / "board") as board:
        board.time_of = lambda ms: round(ms * per_ms)
        lost = await loss_of(board, time_unit=unit)
    assert ratio in lost[0]
    assert remedy in lost[1]


@pytest.mark.parametrize(
    ("unit", "per_ms", "wrap_ms", "written"),
    [
        ("ms", 1, 65_536, "65536"),
        ("us", 1000, 2**24 / 1000, "16777216"),
        ("ms", 1, 60_000, "60000"),
    ],
)
async def test_a_time_that_wraps_is_asked_about_and_then_followed(
    tmp_path, unit, per_ms, wrap_ms, written
):
    def beginning_before(board):
        begin_ms = wrap_ms - 3000
        board.time_of = lambda ms: int((begin_ms + ms) % wrap_ms * per_ms)

    with FakeBoard(tmp_path / "board") as board:
        beginning_before(board)
        reason, remedy = await loss_of(board, time_unit=unit)
    assert f"went back by {wrap_ms / 1000:g} s; does it wrap there?" in reason
    assert f"set time_wrap = {written} " in remedy
    with FakeBoard(tmp_path / "other") as board:
        beginning_before(board)
        rig = BoardRig(board, time_unit=unit, time_wrap=float(written))
        with rig.driver:
            deliveries = await streaming(rig, 200.0)
            await deliveries.until(
                lambda: board.seq * PERIOD_MS > 4500, "lines after the wrap"
            )
        assert deliveries.of(DeviceLost) == []
    blocks = deliveries.of(CountSamples)
    late_ns = [int(block.received_ns - block.sample_time_ns[-1]) for block in blocks]
    assert min(late_ns) >= 0
    assert sum(0 <= ns < 30_000_000 for ns in late_ns) > 0.9 * len(late_ns)


async def test_a_time_that_goes_back_by_no_wrap_is_a_reset(tmp_path):
    with FakeBoard(tmp_path / "board") as board:
        board.time_of = lambda ms: ms + 7300 if ms < 3000 else ms
        reason, remedy = await loss_of(board)
    _, _, back = reason.partition("probably reset: its time went back by ")
    assert float(back.removesuffix(" s")) == pytest.approx(7.3, abs=0.2)
    assert "supply" in remedy


async def test_lines_without_a_time_are_uncertain_where_some_may_have_waited(tmp_path):
    pattern = PATTERN.replace("{time}", "{skip}")
    with FakeBoard(tmp_path / "board") as board:
        rig = BoardRig(board, pattern=pattern)
        with rig.driver:
            deliveries = await streaming(rig, 200.0)

            def uncertain():
                return [
                    bool((block.status & STATUS_TIME_UNCERTAIN).any())
                    for block in deliveries.of(CountSamples)
                ]

            await deliveries.until(lambda: uncertain()[-1:] == [False], "steady lines")
            steady = len(uncertain())
            rig.lose(20)  # as of a computer that stalls until its buffer is full
            await deliveries.until(lambda: any(uncertain()[steady:]), "a bunch")
            await deliveries.until(lambda: not uncertain()[-1], "steady lines again")


async def test_lines_of_another_form_are_shown_in_the_loss(tmp_path, monkeypatch):
    monkeypatch.setattr("traverse.drivers.text_line.driver.FIRST_S", 0.5)
    with FakeBoard(tmp_path / "board") as board:
        rig = BoardRig(board, pattern="{joint};{joint}", checksum="none")
        with rig.driver:
            deliveries = Deliveries(rig.delivery_queue)
            await deliveries.until(
                lambda: (
                    "'$TRV,"
                    in "".join(lost.reason for lost in deliveries.of(DeviceLost))
                ),
                "a loss that shows a line",
            )
    assert "pattern" in deliveries.of(DeviceLost)[-1].remedy


FORMS = {
    "toy-department": (
        4,
        {
            "pattern": "POS,{time},{skip},{skip},{skip}" + 4 * ",{joint}",
            "unit": "deg",
            "decimals": 2,
            "start_command": "START",
            "ignore": ("ACK,", "ERROR,", "INFO,"),
        },
    ),
    "bl-shopwork": (
        5,
        {
            "pattern": "*** " + ", ".join(f"E{k}: {{joint}}" for k in range(5)),
            "unit": "deg",
            "decimals": 2,
        },
    ),
    "sketch": (
        6,
        {
            "pattern": "$TRV,{seq},{time}" + 6 * ",{joint}" + ",{buttons}*{checksum}",
            "checksum": "xor",
        },
    ),
}


@pytest.mark.parametrize("form", FORMS)
async def test_each_simulated_board_is_read(tmp_path, form):
    n_joints, options = FORMS[form]
    table = TextLineTable(kind="text-line", id="t", port="board", form=form)
    mounting = mounted(tmp_path, table, n_channels=n_joints, per_turn=36_000)
    with SimulatedPeer(
        tmp_path / "board", lambda: SimulatedTextLine(table, mounting), mounting
    ) as board:
        counts_per_turn = (36_000,) * n_joints
        rig = PeerRig(board, TextLineDriver, counts_per_turn=counts_per_turn, **options)
        with rig.driver:
            deliveries = await streaming(rig, 100.0)
            await deliveries.until(lambda: len(deliveries.seqs()) >= 20, "samples")
    for block in deliveries.of(CountSamples):
        assert block.counts.shape[1] == n_joints
        ahead = (block.counts[:, 1:] - block.counts[:, :-1].astype(int)) % 36_000
        assert (abs(ahead - 1000) <= 1).all()  # the hinge's channels are 1000 apart
    rate_hz = deliveries.of(DeviceUp)[0].identity.max_rate_hz
    if "{time}" in options["pattern"]:  # others are as regular as this computer
        assert rate_hz == pytest.approx(100.0, rel=1e-6)
    assert deliveries.of(LatchedCounts) == []


class SwingingCounts:
    """Two joints swing to and fro, twice in a second."""

    def counts(self, script_s, noise):
        del noise
        swing = np.rint(8000.0 * np.sin(4.0 * np.pi * script_s)).astype(np.int64)
        return np.column_stack([swing, -swing]) % 65_536


@pytest.mark.parametrize("rate_hz", [100.0, 200.0])
async def test_old_counts_in_lines_that_are_no_samples_are_seen(tmp_path, rate_hz):
    """The board prints 200 lines a second; where all are samples the daemon looks."""
    table = TextLineTable(kind="text-line", id="t", port="board", rate_hz=200.0)
    fault = {"kind": "unread", "channel": 1, "probability": 0.02}
    mounting = replace(mounted(tmp_path, table, fault), source=SwingingCounts())
    with SimulatedPeer(
        tmp_path / "board", lambda: SimulatedTextLine(table, mounting), mounting
    ) as board:
        rig = PeerRig(board, TextLineDriver, **OPTIONS)
        with rig.driver:
            deliveries = await streaming(rig, rate_hz)
            n_samples = 3 * rate_hz
            await deliveries.until(lambda: len(deliveries.seqs()) > n_samples, "3 s")
    repeats = deliveries.of(RepeatedCount)
    if rate_hz == 200.0:
        assert repeats == []
        return
    assert repeats
    for repeat in repeats:
        assert (repeat.device, repeat.channel) == ("device", 1)
        assert repeat.n_readings == 1
        assert repeat.period_ns == pytest.approx(5_000_000, rel=0.2)
        assert 0.3e-3 < abs(repeat.off_rad) < 60e-3  # the way in 5 ms

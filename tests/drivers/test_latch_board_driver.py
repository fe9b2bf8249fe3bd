import asyncio
import fcntl
import os
import termios
import time

import pytest

from drivers.crossing import Crossing
from drivers.latch_board import LatchBoard
from drivers.registry import driver_class
from drivers.values import (
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from tests.drivers import board_bodies as bodies
from tests.drivers.driver_contract import (
    DriverContract,
    KeptEdgeContract,
    LatchContract,
    StreamContract,
    streaming,
)
from tests.drivers.fake_board import (
    CONFIGURE,
    HELLO,
    LATCH,
    START,
    FakeBoard,
)
from tests.drivers.taken import Taken, until
from tests.protocol.latch_board_frames import framed


class LatchBoardRig:
    def __init__(self, board: FakeBoard) -> None:
        self.board = board
        self.port = str(board.link)
        self.crossing = Crossing(asyncio.get_running_loop())
        self.driver = LatchBoard("base", self.crossing, port=self.port)
        self._last: list[bytes] = []
        self._broken = False

    def emit(self, n):
        self._last = self.board.emit(n)

    def lose(self, n):
        self.board.samples(n)

    def press(self):
        if not self._broken:
            return self.board.press()
        self._broken = False
        self.board.repeats_edges = False
        seq = self.board.press()
        spoilt = bytearray(framed(self.board.edges[seq]))
        spoilt[5] ^= 0x40
        later = self.board.next_edge
        overtaking = bodies.edge(0, 0, later, self.board.ticks(), self.board.counts)
        self.board.send_bytes(bytes(spoilt))
        self.board.send(overtaking)
        self.board.repeats_edges = True
        return seq

    def break_next(self):
        self._broken = True

    def repeat_last_samples(self):
        self.board.send(*self._last)

    def unacknowledged(self):
        return set(self.board.edges)

    def unplug(self):
        self.board.unplug()

    def plug(self):
        self.board.plug()


@pytest.fixture
def board(tmp_path):
    with FakeBoard(tmp_path / "ttyBoard") as board:
        yield board


@pytest.fixture
async def rig(board):
    rig = LatchBoardRig(board)
    yield rig
    rig.driver.close()


class TestLatchBoardContract(
    DriverContract, StreamContract, KeptEdgeContract, LatchContract
):
    pass


async def told_lost(rig) -> DeviceLost:
    taken = Taken(rig.crossing)
    with rig.driver:
        await taken.until(lambda: taken.of(DeviceLost), "the loss")
    return taken.of(DeviceLost)[0]


def test_the_registry_knows_it():
    assert driver_class("latch-board") is LatchBoard
    with pytest.raises(KeyError):
        driver_class("latchboard")


async def test_samples_lost_on_the_line_leave_a_gap_of_their_number(rig):
    with rig.driver:
        taken = await streaming(rig)
        rig.emit(5)
        rig.lose(3)
        rig.emit(5)
        await taken.until(lambda: len(taken.seqs()) >= 10, "10 samples")
    assert taken.seqs() == [0, 1, 2, 3, 4, 8, 9, 10, 11, 12]
    faults = [f for f in taken.of(DeviceFault) if f.code == "samples_lost"]
    assert sum(fault.count for fault in faults) == 3


async def test_repeated_samples_are_taken_once(rig):
    with rig.driver:
        taken = await streaming(rig)
        rig.emit(4)
        rig.repeat_last_samples()
        rig.emit(1)
        await taken.until(lambda: 4 in taken.seqs(), "the last sample")
    assert taken.seqs() == [0, 1, 2, 3, 4]
    assert taken.of(DeviceFault) == []


async def test_who_the_board_is_and_what_it_tells_by_itself(rig):
    with rig.driver:
        taken = await streaming(rig)
        rig.board.send(
            bodies.temperatures(5, 2300, -32768),
            bodies.alarm(1, 1, 1, 350),
            bodies.alarm(0xFF, 0, 0x8001, 2),
        )
        await taken.until(lambda: len(taken.of(DeviceAlarm)) == 2, "alarms")
        await taken.until(lambda: taken.of(DeviceCounters), "counters")
    identity = taken.of(DeviceUp)[0].identity
    assert identity.name == f"latch board {bodies.BOARD_ID.hex()}"
    assert identity.firmware == "1.2.3"
    assert identity.moduli_counts == (1 << 23, 1 << 20)
    assert (identity.inputs, identity.max_rate_hz) == (2, 10_000.0)
    assert taken.of(DeviceTemperatures)[0].values_c == (23.0, None)
    first, second = taken.of(DeviceAlarm)
    assert (first.channel, first.raised, first.code, first.value) == (1, True, 1, 350)
    assert first.text == "encoder signal weak"
    assert (second.channel, second.raised, second.code) == (None, False, 0x8001)


async def test_requests_are_those_of_the_specification(rig):
    with rig.driver:
        await streaming(rig)
    assert rig.board.heard(HELLO)[0] == bytes((1, 1, 1, 1))
    # All inputs, heartbeat 500 ms, temperatures 2000 ms, 5000 us of debouncing.
    assert rig.board.heard(CONFIGURE)[0].hex(" ") == "02 02 ff f4 01 d0 07 88 13 00 00"
    assert rig.board.heard(START)[0].hex(" ") == "03 03 20 a1 07 00"  # 500 000 mHz


async def test_a_port_in_use_is_told(rig):
    holder = os.open(rig.port, os.O_RDWR | os.O_NOCTTY)
    try:
        fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)  # as pyserial does it
        lost = await told_lost(rig)
    finally:
        fcntl.ioctl(holder, termios.TIOCNXCL)
        os.close(holder)
    assert "in use by another program" in lost.reason
    assert lost.remedy == "stop that program"


async def test_a_file_that_is_no_port_is_told(tmp_path):
    path = tmp_path / "plain"
    path.write_text("no port")
    crossing = Crossing(asyncio.get_running_loop())
    taken = Taken(crossing)
    with LatchBoard("base", crossing, port=str(path)):
        await taken.until(lambda: taken.of(DeviceLost), "the loss")
    assert str(path) in taken.of(DeviceLost)[0].reason


async def test_a_board_that_does_not_answer_is_told(rig):
    rig.board.answers[HELLO] = lambda body: []
    lost = await told_lost(rig)
    assert "does not answer HELLO" in lost.reason
    numbers = [body[1] for body in rig.board.heard(HELLO)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 8


async def test_a_board_of_another_version_is_told(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.reply(HELLO, body[1], 4, 2)]
    lost = await told_lost(rig)
    assert "protocol version not supported (value 2)" in lost.reason
    assert "firmware" in lost.remedy or "configuration" in lost.remedy


async def test_a_hello_of_another_version_is_told(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], major=2)]
    lost = await told_lost(rig)
    assert "speaks version 2" in lost.reason


async def test_a_board_of_which_nothing_can_come_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [
        bodies.hello(body[1], channels=(), inputs=0)
    ]
    assert "neither channels nor inputs" in (await told_lost(rig)).reason


async def test_a_board_with_impossible_channels_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=((33, 0),))]
    assert "impossible channels" in (await told_lost(rig)).reason


async def test_a_board_with_inputs_only_tells_its_edges(rig):
    rig.board.counts = ()
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=())]
    with rig.driver:
        taken = Taken(rig.crossing)
        await taken.until(lambda: taken.of(DeviceUp), "the board")
        tokens = [rig.board.press(1), rig.board.press(1, level=0)]
        await taken.until(lambda: len(taken.of(LatchedCounts)) == 2, "its edges")
        rig.driver.acknowledge(tokens[1])
        await until(lambda: not rig.board.edges, "the acknowledgement")
    identity = taken.of(DeviceUp)[0].identity
    assert (identity.moduli_counts, identity.inputs) == ((), 2)
    assert (identity.latches, identity.max_rate_hz) == (False, 0.0)
    latches = taken.of(LatchedCounts)
    assert [latch.token for latch in latches] == tokens
    assert {(latch.counts, latch.status) for latch in latches} == {((), ())}
    # Its heartbeat is all that tells its time, so it is asked for more often.
    assert rig.board.heard(CONFIGURE)[0].hex(" ").startswith("02 02 ff 14 00")


async def test_the_makers_own_bits_of_status_are_a_warning(rig):
    with rig.driver:
        taken = await streaming(rig)
        sample = bytearray(rig.board.samples(1)[0])
        sample[-2:] = 0x80, 0x41  # of two channels, the second with an error
        rig.board.send(bytes(sample))
        await taken.until(lambda: taken.of(CountSamples), "the sample")
    assert taken.of(CountSamples)[0].status.tolist() == [[2, 3]]


async def test_a_board_whose_counter_stands_is_refused(rig):
    rig.board.answers[HELLO] = lambda body: [bodies.hello(body[1], tick_rate_hz=0)]
    assert "0 Hz" in (await told_lost(rig)).reason


async def test_a_refused_configuration_is_told(rig):
    rig.board.answers[CONFIGURE] = lambda body: [bodies.reply(CONFIGURE, body[1], 5)]
    lost = await told_lost(rig)
    assert "refused CONFIGURE: value out of range" in lost.reason


async def test_a_refused_rate_does_not_cost_the_connection(rig):
    good = rig.board.answers[START]
    rig.board.answers[START] = lambda body: [bodies.reply(START, body[1], 3, 99_000)]
    with rig.driver:
        taken = Taken(rig.crossing)
        await taken.until(lambda: taken.of(DeviceUp), "the device is up")
        rig.driver.request_stream(500.0)
        await taken.until(lambda: taken.of(DeviceFault), "the refusal")
        rig.board.answers[START] = good
        rig.driver.request_stream(50.0)
        await taken.until(lambda: taken.of(StreamStarted), "the stream")
    (fault,) = taken.of(DeviceFault)
    assert fault.code == "request_refused"
    assert "rate out of range (value 99000)" in fault.text
    assert taken.of(DeviceLost) == []


async def test_a_request_is_asked_again_and_answered_once(rig):
    late: list[bytes] = []

    def latch(body):
        late.append(body)
        if len(late) == 1:
            return []
        return [p for b in late for p in rig.board.answer_latch(b)]  # both, late

    rig.board.answers[LATCH] = latch
    with rig.driver:
        taken = await streaming(rig)
        token = rig.driver.request_latch()
        await taken.until(lambda: taken.of(LatchedCounts), "the latch")
        rig.emit(1)
        await taken.until(taken.seqs, "a sample after it")
    assert [latch.token for latch in taken.of(LatchedCounts)] == [token]
    assert late[0][1] != late[1][1]  # a number of its own for each try


async def test_too_many_latch_requests_are_refused(rig):
    for _ in range(16):
        rig.driver.request_latch()
    with pytest.raises(Exception, match="16 latch requests wait"):
        rig.driver.request_latch()


async def test_closing_while_connecting_does_not_wait_for_the_board(rig):
    rig.board.answers[HELLO] = lambda body: []
    rig.driver.start()
    await until(lambda: rig.board.heard(HELLO), "the first HELLO")
    await asyncio.to_thread(rig.driver.close)
    # A driver that waits for all its tries would have asked eight times.
    assert len(rig.board.heard(HELLO)) <= 2
    taken = Taken(rig.crossing)
    rig.crossing.put(DeviceUp("end", None, False))
    await taken.until(lambda: taken.of(DeviceUp), "what was delivered")
    assert taken.of(DeviceLost) == []  # closing is no loss


async def test_silence_of_the_board_is_a_loss(board):
    skipped_ns = [0]
    crossing = Crossing(asyncio.get_running_loop())
    taken = Taken(crossing)
    with LatchBoard(
        "base",
        crossing,
        port=str(board.link),
        monotonic_ns=lambda: time.monotonic_ns() + skipped_ns[0],
    ):
        await taken.until(lambda: taken.of(DeviceUp), "the device is up")
        board.mute = True
        board.answers[HELLO] = lambda body: []
        await asyncio.sleep(0)
        skipped_ns[0] = 3_000_000_000
        await taken.until(lambda: taken.of(DeviceLost), "the loss")
    assert "silent for 2 s" in taken.of(DeviceLost)[0].reason


async def test_a_board_that_was_restarted_behind_an_open_port_is_noticed(rig):
    with rig.driver:
        taken = await streaming(rig)
        for seq in range(3):
            rig.press()
            await taken.until(lambda n=seq: len(taken.of(LatchedCounts)) > n, "edge")
            rig.driver.acknowledge(seq)
        rig.board.restart()
        await taken.until(lambda: len(taken.of(DeviceUp)) == 2, "up again")
        await taken.until(lambda: len(taken.of(StreamStarted)) == 2, "its stream")
        rig.press()
        await taken.until(lambda: len(taken.of(LatchedCounts)) == 4, "a new edge")
    assert "stopped its stream" in taken.of(DeviceLost)[0].reason
    assert taken.of(DeviceUp)[1].restarted
    assert [latch.token for latch in taken.of(LatchedCounts)] == [0, 1, 2, 0]


async def test_a_restart_is_told_even_if_connecting_fails_at_first(rig):
    good = rig.board.answers[CONFIGURE]
    refusals = []

    def refuse_once(body):
        refusals.append(body)
        return (
            [bodies.reply(CONFIGURE, body[1], 5)] if len(refusals) == 1 else good(body)
        )

    with rig.driver:
        taken = await streaming(rig)
        rig.board.answers[CONFIGURE] = refuse_once
        rig.board.restart()
        rig.press()
        await taken.until(lambda: taken.of(LatchedCounts), "the edge after it")
    ups = taken.of(DeviceUp)
    assert [up.restarted for up in ups] == [False, True]
    # Its counts are to be read with the knowledge of the restart.
    assert taken.all.index(ups[1]) < taken.all.index(taken.of(LatchedCounts)[0])


async def test_noise_costs_the_frames_it_touches_and_is_counted(rig):
    with rig.driver:
        taken = await streaming(rig)
        one, two, three = (framed(body) for body in rig.board.samples(3))
        spoilt = bytes((two[0],)) + bytes(b ^ 0x10 or 1 for b in two[1:-1]) + b"\0"
        rig.board.send_bytes(b"\x07noise\0" + one + spoilt + three)
        await taken.until(lambda: 2 in taken.seqs(), "the last sample")
        await taken.until(
            lambda: any(
                counters.values.get("frames_rejected") == 2
                for counters in taken.of(DeviceCounters)
            ),
            "the counter",
        )
    assert taken.seqs() == [0, 2]
    codes = {fault.code for fault in taken.of(DeviceFault)}
    assert codes == {"samples_lost", "frames_rejected"}


async def test_frames_with_other_channels_never_reach_the_consumer(rig):
    with rig.driver:
        taken = await streaming(rig)
        request = rig.board.stream_request
        rig.board.send(
            bodies.sample(request, 0, 5, (1, 2, 3)), bodies.edge(0, 1, 0, 5, (1,))
        )
        rig.board.samples(1)
        rig.emit(1)
        await taken.until(taken.seqs, "the good sample")
    assert taken.seqs() == [1]
    assert taken.of(LatchedCounts) == []
    assert "channels_changed" in {fault.code for fault in taken.of(DeviceFault)}


async def test_samples_of_an_older_stream_are_left_out(rig):
    with rig.driver:
        taken = await streaming(rig)
        old = rig.board.samples(3)
        rig.driver.request_stream(100.0)
        await taken.until(lambda: len(taken.of(StreamStarted)) == 2, "second stream")
        rig.board.send(*old)
        rig.emit(2)
        await taken.until(lambda: len(taken.seqs()) == 2, "samples")
    second = taken.of(StreamStarted)[1]
    assert {block.stream for block in taken.of(CountSamples)} == {second.stream}
    assert second.rate_hz == 100.0


async def test_a_loss_at_the_end_is_told_by_the_heartbeat(rig):
    with rig.driver:
        taken = await streaming(rig)
        rig.emit(2)
        rig.lose(4)
        await taken.until(lambda: taken.of(DeviceFault), "the loss")
    (fault,) = taken.of(DeviceFault)
    assert (fault.code, fault.count) == ("samples_lost", 4)


async def test_an_edge_that_the_consumer_has_no_room_for_comes_again(board):
    crossing = Crossing(asyncio.get_running_loop(), max_others=8)
    taken = Taken(crossing)
    with LatchBoard("base", crossing, port=str(board.link)) as driver:
        await taken.until(lambda: taken.of(DeviceUp), "the device is up")
        driver.request_stream(100.0)
        await taken.until(lambda: taken.of(StreamStarted), "the stream")
        while crossing.put(DeviceTemperatures("filler", ())):
            pass
        seq = board.press()
        sent = len(board.requests)
        board.send(board.edges[seq])
        driver.request_latch()  # its request shows that the edge has been read
        await until(lambda: len(board.requests) > sent, "the latch request")
        assert seq in board.edges
        await taken.until(
            lambda: any(e.input == 0 for e in taken.of(LatchedCounts)), "the edge"
        )
    edges = [latch for latch in taken.of(LatchedCounts) if latch.input == 0]
    assert [latch.token for latch in edges] == [seq]


async def test_a_fault_of_the_driver_itself_reaches_the_consumer(board, caplog):
    def broken_clock() -> int:
        raise ZeroDivisionError("no time")

    crossing = Crossing(asyncio.get_running_loop())
    taken = Taken(crossing)
    driver = LatchBoard("base", crossing, port=str(board.link))
    driver._now_ns, good = broken_clock, driver._now_ns
    driver._pause = lambda seconds: None
    with driver:
        await taken.until(lambda: taken.of(DeviceLost), "the loss")
        driver._now_ns = good
        await taken.until(lambda: taken.of(DeviceUp), "the device")
    assert "no time" in taken.of(DeviceLost)[0].reason
    assert "fault in the driver of base" in caplog.text

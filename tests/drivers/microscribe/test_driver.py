import asyncio

import numpy as np
import pytest

from tests.drivers.microscribe.fake_arm import FakeMicroscribe
from traverse.drivers.base.registry import driver_class
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.drivers.microscribe.driver import MicroscribeDriver
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import (
    DriverContract,
    EdgeContract,
    StreamContract,
    up,
)
from traverse.testing.pty_peer import PeerRig, rig_fixture
from traverse.testing.waiting import until


class MicroscribeRig(PeerRig):
    def __init__(self, arm: FakeMicroscribe, **options) -> None:
        super().__init__(arm, MicroscribeDriver, **options)
        self.arm = arm
        self._down = False

    def lose(self, n):
        self.arm.n_lost = n

    def press(self):
        self._down = not self._down
        self.arm.press(0, self._down)
        self.arm.serve(12)  # two packets show it, and then its bouncing is over


rig = rig_fixture(lambda folder: MicroscribeRig(FakeMicroscribe(folder / "arm")))


class TestContract(DriverContract, StreamContract, EdgeContract):
    parts = (1, 7, 40)
    dropped = ("packets_old", "bytes_stray")


async def test_it_is_found_by_its_name():
    assert driver_class("microscribe") is MicroscribeDriver


async def test_what_the_arm_says_of_itself_is_reported(rig):
    with rig.driver:
        deliveries = await up(rig)
    (ups,) = deliveries.of(DeviceUp)
    identity = ups.identity
    assert identity.name == "MicroScribe 3D 3DX 12345"
    assert identity.firmware == "HCI 2.0a"
    assert identity.moduli_counts == identity.counts_per_turn == (8000,) * 6
    assert identity.inputs == 7
    assert not identity.latches
    assert identity.max_rate_hz > 50.0


@pytest.mark.parametrize(("hci", "n_joints"), [(2, 5), (3, 6), (3, 7)])
async def test_either_version_and_any_number_of_joints(tmp_path, hci, n_joints):
    with FakeMicroscribe(tmp_path / "arm", hci, n_joints) as arm:
        rig = MicroscribeRig(arm)
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await deliveries.until(lambda: len(deliveries.seqs()) >= 3, "3 samples")
    block = deliveries.of(CountSamples)[0]
    assert block.counts.shape[1] == n_joints
    assert block.counts[0, 1:].tolist() == arm.counts[1:n_joints]


@pytest.mark.parametrize("baud_rate", [9600, 57600])
async def test_the_arm_follows_the_baud_rate(tmp_path, baud_rate):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        rig = MicroscribeRig(arm, baud_rate=baud_rate)
        with rig.driver:
            await up(rig)
            assert arm.box.baud_rate == baud_rate
        await until(lambda: arm.box.baud_rate is None, "the session ends")


async def test_a_session_left_behind_at_another_rate_is_ended(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        arm.box.baud_rate = 19200
        rig = MicroscribeRig(arm)
        with rig.driver:
            await up(rig)
        assert arm.n_sessions == 1


async def test_an_arm_that_lost_power_is_reported_as_restarted(rig):
    with rig.driver:
        deliveries = await up(rig)
        await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
        rig.arm.power_cycle()
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
        await deliveries.until(lambda: len(deliveries.of(DeviceUp)) == 2, "it is back")
    assert [ups.restarted for ups in deliveries.of(DeviceUp)] == [False, True]
    assert "does not answer" in deliveries.of(DeviceLost)[0].reason


async def test_an_edge_has_the_counts_of_its_own_packet(rig):
    with rig.driver:
        deliveries = await up(rig, 500.0)
        await deliveries.until(lambda: len(deliveries.seqs()) > 20, "samples")
        rig.arm.press(1, True)
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
        (edge,) = deliveries.of(LatchedCounts)
        await deliveries.until(
            lambda: (
                deliveries.of(CountSamples)[-1].sample_time_ns[-1] > edge.sample_time_ns
            ),
            "samples after it",
        )
    assert (edge.input, edge.active) == (1, True)
    rows = [
        (int(t), tuple(map(int, counts)), int(inputs))
        for block in deliveries.of(CountSamples)
        for t, counts, inputs in zip(
            block.sample_time_ns, block.counts, block.inputs, strict=True
        )
    ]
    assert (edge.sample_time_ns, edge.counts, 2) in rows
    assert all(inputs == 0 for t, _, inputs in rows if t < edge.sample_time_ns)


async def test_pedals_are_read_without_a_stream(rig):
    with rig.driver:
        deliveries = await up(rig, 0.0)
        rig.arm.press(0, True)
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
    assert deliveries.of(CountSamples) == []
    assert len(deliveries.of(LatchedCounts)[0].counts) == 6


async def test_a_slow_stream_is_counted_by_its_own_schedule(rig):
    with rig.driver:
        deliveries = await up(rig, 40.0)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 8, "8 samples")

        def n_missing() -> int:
            return deliveries.seqs()[-1] + 1 - len(deliveries.seqs())

        def n_lost() -> int:
            faults = deliveries.of(DeviceFault)
            return sum(f.count for f in faults if f.code == "samples_lost")

        # A busy machine may miss an instant: that is a gap, and reported in a while.
        await deliveries.until(lambda: n_lost() >= n_missing(), "the report of gaps")
    seqs = np.array(deliveries.seqs())
    assert seqs[0] == 0
    times_ns = np.concatenate([b.sample_time_ns for b in deliveries.of(CountSamples)])
    per_number_ns = (times_ns[-1] - times_ns[0]) / (seqs[-1] - seqs[0])
    assert per_number_ns == pytest.approx(25e6, rel=0.2)


async def test_a_count_that_cannot_be_is_missing_and_told(rig):
    with rig.driver:
        deliveries = await up(rig, 500.0)
        await deliveries.until(lambda: len(deliveries.seqs()) > 20, "samples")
        before = rig.arm.counts[2]
        rig.arm.move(0, 0, 3000)
        await deliveries.until(lambda: missing(deliveries, 2), "a reading is missing")
        # It stays there: after a few packets it is believed.
        await deliveries.until(
            lambda: int(deliveries.of(CountSamples)[-1].counts[-1, 2]) == before + 3000,
            "the new place",
        )
        await deliveries.until(
            lambda: [
                f for f in deliveries.of(DeviceFault) if f.code == "readings_missing"
            ],
            "it is reported",
        )
    assert all(before in (c, 0) or s == 0 for c, s in missing(deliveries, 2))


def missing(deliveries: Deliveries, channel: int) -> list[tuple[int, int]]:
    return [
        (int(counts[channel]), int(status[channel]))
        for block in deliveries.of(CountSamples)
        for counts, status in zip(block.counts, block.status, strict=True)
        if status[channel] & STATUS_MISSING
    ]


async def test_a_late_answer_is_not_taken_for_the_next_one(rig):
    with rig.driver:
        deliveries = await up(rig, 100.0)
        await deliveries.until(lambda: len(deliveries.seqs()) >= 5, "samples")
        rig.arm.late_s = 0.15
        n = len(deliveries.seqs())
        await deliveries.until(
            lambda: len(deliveries.seqs()) >= n + 40, "samples after it"
        )
    blocks = deliveries.of(CountSamples)
    times_ns = np.concatenate([block.sample_time_ns for block in blocks])
    counts = np.concatenate([block.counts[:, 0] for block in blocks])
    assert (np.diff(times_ns) > 0).all()
    # Requests are 10 ms apart, and the late one was given up after 20 ms.
    latched_ns = np.array([rig.arm.latched_ns[count] for count in counts])
    assert np.abs(times_ns - latched_ns).max() < 10e6


@pytest.mark.parametrize("rate_hz", [900.0, 995.0, 1100.0])
async def test_a_timer_that_runs_off_its_rate_loses_no_connection(tmp_path, rate_hz):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        arm.timer_rate_hz = rate_hz
        rig = MicroscribeRig(arm)
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await asyncio.sleep(1.5)
            rig.lose(3)
            await deliveries.until(
                lambda: "samples_lost" in {f.code for f in deliveries.of(DeviceFault)},
                "losses",
            )
            # Within 1 % after about a second; a busy machine may be late now and then.
            await deliveries.until(
                lambda: is_learned(deliveries, rate_hz), "the timer's rate"
            )
        assert not deliveries.of(DeviceLost)
        codes = {fault.code for fault in deliveries.of(DeviceFault)}
        assert "samples_lost" in codes
        assert "timer_unused" not in codes


def is_learned(deliveries: Deliveries, rate_hz: float) -> bool:
    """The rate is within 1 %, and hardly a packet is taken for an old one."""
    return any(
        counters.values["timer_hz"] == pytest.approx(rate_hz, rel=0.01)
        and counters.values["packets_old"] < 0.05 * counters.values["packets_received"]
        for counters in deliveries.of(DeviceCounters)[-1:]
    )


def faults_but_of_load(deliveries: Deliveries) -> list[str]:
    """Codes of faults; a busy machine finds the line slower than it is."""
    codes = [fault.code for fault in deliveries.of(DeviceFault)]
    return [code for code in codes if code != "rate_limited"]


async def test_a_timer_of_another_rate_is_left_alone(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        arm.timer_rate_hz = 250.0
        rig = MicroscribeRig(arm)
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await deliveries.until(lambda: len(deliveries.seqs()) >= 3, "3 samples")
    assert faults_but_of_load(deliveries) == ["timer_unused"]


async def test_reports_of_motion_are_samples(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        rig = MicroscribeRig(arm, report="motion")
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
            for n in range(1, 6):
                arm.move(0, 1)  # a hand does not make a joint at rest jump
                await deliveries.until(
                    lambda n=n: len(deliveries.seqs()) >= n, f"{n} samples"
                )
            arm.press(0, True)
            await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
            # A still arm is polled now and then.
            n = len(deliveries.seqs())
            await deliveries.until(
                lambda: len(deliveries.seqs()) >= n + 2, "it is asked"
            )
            arm.move(0, 2)
            await deliveries.until(
                lambda: (
                    int(deliveries.of(CountSamples)[-1].counts[-1, 1]) == arm.counts[1]
                ),
                "motion again",
            )
    # Where the machine was suspended, the arm was lost and a new stream has begun.
    streams = {block.stream for block in deliveries.of(CountSamples)}
    assert len(streams) <= 1 + len(deliveries.of(DeviceLost))
    for stream in streams:
        blocks = [b for b in deliveries.of(CountSamples) if b.stream == stream]
        seqs = [int(seq) for block in blocks for seq in block.seq]
        assert seqs == list(range(len(seqs)))
    assert faults_but_of_load(deliveries) == []


async def test_a_report_that_is_cut_by_its_end_is_not_broken(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        rig = MicroscribeRig(arm, report="motion")
        with rig.driver:
            deliveries = await up(rig, 100.0)
            await deliveries.until(lambda: len(deliveries.seqs()) >= 1, "a sample")
            arm.held_back = True
            arm.move(0, 3)
            await deliveries.until(
                lambda: (
                    int(deliveries.of(CountSamples)[-1].counts[-1, 1]) == arm.counts[1]
                ),
                "its counts, as it was asked after that",
            )
            await deliveries.until(
                lambda: (
                    deliveries.of(DeviceCounters)[-1].values["packets_received"] >= 4
                ),
                "packets after it",
            )
    assert deliveries.of(DeviceFault) == []


async def test_something_else_on_the_port_is_refused(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        arm.rewrite(maxes=(0,) * 6)
        rig = MicroscribeRig(arm)
        with rig.driver:
            deliveries = Deliveries(rig.delivery_queue)
            await deliveries.until(lambda: deliveries.of(DeviceLost), "the refusal")
    (lost,) = deliveries.of(DeviceLost)[:1]
    assert "greatest counts" in lost.reason
    assert "MicroScribe" in lost.remedy


async def test_a_silent_port_names_its_baud_rate(tmp_path):
    with FakeMicroscribe(tmp_path / "arm") as arm:
        arm.mute = True
        rig = MicroscribeRig(arm)
        with rig.driver:
            deliveries = Deliveries(rig.delivery_queue)
            await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    assert "115200 baud" in deliveries.of(DeviceLost)[0].reason

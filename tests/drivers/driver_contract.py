"""What every driver must do, as a suite: subclass it and say how to build a rig.

A rig is a driver with a simulated device that a test can command. The suite asks it
only for what every device has; a device's own habits are tested beside it.
"""

import threading
from typing import Protocol

from drivers.crossing import Crossing
from drivers.driver import Driver
from drivers.values import (
    CountSamples,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from tests.drivers.taken import Taken, until

RATE_HZ = 500.0


class Rig(Protocol):
    """A driver and the device that it reads."""

    crossing: Crossing
    driver: Driver
    port: str

    def emit(self, n: int) -> None:
        """Send n samples; counts of channel 0 go up by one from sample to sample."""

    def lose(self, n: int) -> None:
        """Latch n samples and lose them on the line."""

    def press(self) -> int:
        """Change an input; gives the token of the edge."""

    def break_next(self) -> None:
        """Spoil whatever is sent next."""

    def repeat_last_samples(self) -> None:
        """Send the last samples once more."""

    def unacknowledged(self) -> set[int]:
        """Tokens of the edges that the device still keeps."""

    def unplug(self) -> None:
        """The port goes away."""

    def plug(self) -> None:
        """The port comes back."""


def driver_threads(rig: Rig) -> list[threading.Thread]:
    name = f"driver-{rig.driver.device}"
    return [thread for thread in threading.enumerate() if thread.name == name]


class DriverContract:
    """Inherit as `Test...` and provide a fixture `rig`."""

    async def streaming(self, rig: Rig) -> Taken:
        taken = Taken(rig.crossing)
        await taken.until(lambda: taken.of(DeviceUp), "the device is up")
        rig.driver.request_stream(RATE_HZ)
        await taken.until(lambda: taken.of(StreamStarted), "the stream")
        return taken

    async def test_samples_come_in_order_and_nothing_is_invented(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            for n in (1, 7, 40, 300):
                rig.emit(n)
            await taken.until(lambda: len(taken.seqs()) >= 348, "348 samples")
        assert taken.seqs() == list(range(348))
        blocks = taken.of(CountSamples)
        stream = taken.of(StreamStarted)[0].stream
        assert {block.stream for block in blocks} == {stream}
        counts = [int(c) for block in blocks for c in block.counts[:, 0]]
        assert counts == [counts[0] + k for k in range(348)]
        times_ns = [int(t) for block in blocks for t in block.sample_time_ns]
        assert times_ns == sorted(times_ns)
        assert taken.of(DeviceFault) == []

    async def test_what_is_lost_on_the_line_is_counted_and_leaves_a_gap(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            rig.emit(5)
            rig.lose(3)
            rig.emit(5)
            await taken.until(lambda: len(taken.seqs()) >= 10, "10 samples")
        assert taken.seqs() == [0, 1, 2, 3, 4, 8, 9, 10, 11, 12]
        faults = [f for f in taken.of(DeviceFault) if f.code == "samples_lost"]
        assert sum(fault.count for fault in faults) == 3

    async def test_repeated_samples_are_taken_once(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            rig.emit(4)
            rig.repeat_last_samples()
            rig.emit(1)
            await taken.until(lambda: 4 in taken.seqs(), "the last sample")
        assert taken.seqs() == [0, 1, 2, 3, 4]

    async def test_a_lost_port_is_told_and_comes_back_by_itself(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            rig.unplug()
            await taken.until(lambda: taken.of(DeviceLost), "the loss")
            rig.plug()
            await taken.until(lambda: len(taken.of(DeviceUp)) == 2, "it is back")
            await taken.until(lambda: len(taken.of(StreamStarted)) == 2, "its stream")
            rig.emit(3)
            await taken.until(lambda: len(taken.seqs()) == 3, "samples again")
        first, second = taken.of(StreamStarted)
        assert second.rate_hz == first.rate_hz
        assert second.stream != first.stream
        assert taken.of(DeviceLost)[0].remedy
        assert [up.restarted for up in taken.of(DeviceUp)] == [False, False]

    async def test_edges_come_once_however_often_they_are_sent(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            tokens = [rig.press() for _ in range(3)]
            await taken.until(lambda: len(taken.of(LatchedCounts)) >= 3, "3 edges")
            rig.emit(2)  # the device has repeated them meanwhile
            await taken.until(lambda: len(taken.seqs()) >= 2, "samples after them")
            assert rig.unacknowledged() == set(tokens)  # nobody has dealt with them
            rig.driver.acknowledge(tokens[1])
            await until(lambda: rig.unacknowledged() == {tokens[2]}, "two forgotten")
            rig.driver.acknowledge(tokens[2])
            await until(lambda: not rig.unacknowledged(), "all forgotten")
        assert [latch.token for latch in taken.of(LatchedCounts)] == tokens

    async def test_a_broken_edge_does_not_change_the_order(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            rig.break_next()
            tokens = [rig.press(), rig.press()]
            await taken.until(lambda: len(taken.of(LatchedCounts)) >= 2, "2 edges")
        assert [latch.token for latch in taken.of(LatchedCounts)] == tokens

    async def test_an_edge_during_an_outage_is_delivered_afterwards(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            rig.unplug()
            await taken.until(lambda: taken.of(DeviceLost), "the loss")
            token = rig.press()
            rig.plug()
            await taken.until(lambda: taken.of(LatchedCounts), "the edge")
        assert [latch.token for latch in taken.of(LatchedCounts)] == [token]

    async def test_a_latch_by_request_brings_its_token(self, rig: Rig):
        with rig.driver:
            taken = await self.streaming(rig)
            tokens = [rig.driver.request_latch() for _ in range(3)]
            await taken.until(lambda: len(taken.of(LatchedCounts)) >= 3, "3 latches")
        latches = taken.of(LatchedCounts)
        assert [latch.token for latch in latches] == tokens
        assert {latch.input for latch in latches} == {None}

    async def test_closing_ends_the_thread_and_may_be_repeated(self, rig: Rig):
        rig.driver.start()
        await self.streaming(rig)
        rig.driver.close()
        assert driver_threads(rig) == []
        rig.driver.close()
        rig.driver.request_stream(10.0)  # too late, and harmless
        rig.driver.acknowledge(0)

    async def test_a_driver_that_was_never_started_can_be_closed(self, rig: Rig):
        rig.driver.close()
        assert driver_threads(rig) == []

    async def test_a_missing_port_is_told_once_with_its_name(self, rig: Rig):
        rig.unplug()
        with rig.driver:
            taken = Taken(rig.crossing)
            await taken.until(lambda: taken.of(DeviceLost), "the loss")
            rig.plug()
            await taken.until(lambda: taken.of(DeviceUp), "the device")
        (lost,) = taken.of(DeviceLost)
        assert rig.port in lost.reason
        assert lost.remedy

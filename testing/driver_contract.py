"""Duties of every driver, as suites: subclass them and say how to build a rig.

A rig is a driver with a simulated device that a test can command. Each suite requires
of it only what it needs; a device's own habits are tested beside it.

    DriverContract      every driver: life, loss, recovery, end
    StreamContract      those that stream: order, no invention, loss counted
    EdgeContract        those with inputs: each edge once and in order
    KeptEdgeContract    those that keep edges until they are acknowledged
    LatchContract       those that latch on request
"""

import threading
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import pytest

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import Driver
from traverse.drivers.base.values import (
    STATUS_MISSING,
    STATUS_TIME_UNCERTAIN,
    CountSamples,
    DeviceAlarm,
    DeviceCounters,
    DeviceFault,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.testing.deliveries import Deliveries
from traverse.testing.waiting import until


class Rig(Protocol):
    """A driver and the device that it reads."""

    delivery_queue: DeliveryQueue
    driver: Driver
    port: str  # as it must be in the text of a loss

    def unplug(self) -> None:
        """Remove the port."""

    def plug(self) -> None:
        """Restore the port."""


class StreamRig(Rig, Protocol):
    """A rig whose device sends samples."""

    def emit(self, n: int) -> None:
        """Send n samples; counts of channel 0 go up by one from sample to sample.

        A device that answers or sends by itself does nothing here: it may give more
        than requested.
        """

    def lose(self, n: int) -> None:
        """Measure n samples of which something is lost on the line."""


class EdgeRig(Rig, Protocol):
    """One whose device has inputs."""

    def press(self) -> int | None:
        """Change an input; return the token of the edge, None if made by the driver."""


class KeptEdgeRig(EdgeRig, Protocol):
    """One whose device keeps its edges."""

    def press(self) -> int:
        """Change an input; return the token of the edge."""

    def emit(self, n: int) -> None:
        """Send n samples."""

    def break_next(self) -> None:
        """Spoil the next bytes."""

    def unacknowledged(self) -> set[int]:
        """Tokens of the edges that the device still keeps."""


def driver_threads(rig: Rig) -> list[threading.Thread]:
    name = f"driver-{rig.driver.device}"
    return [thread for thread in threading.enumerate() if thread.name == name]


async def up(rig: Rig, rate_hz: float = 500.0) -> Deliveries:
    """Wait until the device is up and, if it can, has been requested to stream."""
    deliveries = Deliveries(rig.delivery_queue)
    await deliveries.until(lambda: deliveries.of(DeviceUp), "the device is up")
    rig.driver.request_stream(rate_hz)
    return deliveries


async def streaming(rig: Rig, rate_hz: float = 500.0) -> Deliveries:
    deliveries = await up(rig, rate_hz)
    await deliveries.until(lambda: deliveries.of(StreamStarted), "the stream")
    return deliveries


async def unplugged(rig: Rig, deliveries: Deliveries) -> None:
    """Remove the port until that is noticed; it may have been lost once before."""
    n_lost = len(deliveries.of(DeviceLost))
    rig.unplug()
    await deliveries.until(lambda: len(deliveries.of(DeviceLost)) > n_lost, "the loss")


def missing_samples(blocks: Sequence[CountSamples]) -> int:
    """Count samples missing by their numbers, or incomplete by their status."""
    seqs = [int(seq) for block in blocks for seq in block.seq]
    marked = sum(
        int(((block.status & STATUS_MISSING) != 0).any(axis=1).sum())
        for block in blocks
    )
    return seqs[-1] + 1 - len(seqs) + marked


class DriverContract:
    """Every driver. Inherit as `Test...` and provide a fixture `rig`."""

    async def test_a_lost_port_is_reported_and_returns_by_itself(
        self, rig: Rig
    ) -> None:
        with rig.driver:
            deliveries = await up(rig)
            await unplugged(rig, deliveries)
            n_up = len(deliveries.of(DeviceUp))
            rig.plug()
            await deliveries.until(
                lambda: len(deliveries.of(DeviceUp)) > n_up, "it is back"
            )
        assert all(lost.remedy for lost in deliveries.of(DeviceLost))
        assert not any(up.restarted for up in deliveries.of(DeviceUp))

    async def test_closing_ends_the_thread_and_may_be_repeated(self, rig: Rig) -> None:
        rig.driver.start()
        await up(rig)
        rig.driver.close()
        assert driver_threads(rig) == []
        rig.driver.close()
        rig.driver.request_stream(10.0)  # too late, and harmless
        rig.driver.acknowledge(0)

    async def test_a_driver_that_was_never_started_can_be_closed(
        self, rig: Rig
    ) -> None:
        rig.driver.close()
        assert driver_threads(rig) == []

    async def test_a_missing_port_is_reported_once_with_its_name(
        self, rig: Rig
    ) -> None:
        rig.unplug()
        with rig.driver:
            deliveries = Deliveries(rig.delivery_queue)
            await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
            rig.plug()
            await deliveries.until(lambda: deliveries.of(DeviceUp), "the device")
        (lost,) = deliveries.of(DeviceLost)
        assert rig.port in lost.reason
        assert lost.remedy

    async def test_what_it_says_of_itself_agrees_with_itself(self, rig: Rig) -> None:
        with rig.driver:
            deliveries = await up(rig)
        identity = deliveries.of(DeviceUp)[0].identity
        assert identity.name
        assert all(modulus > 1 for modulus in identity.moduli_counts)
        assert len(identity.counts_per_turn) in (0, len(identity.moduli_counts))
        assert (identity.max_rate_hz > 0) == bool(identity.moduli_counts)


class StreamContract:
    """Drivers that stream.

    Attributes:
        parts: samples that are sent, one after the other.
        dropped: counters of answers that were too late for their requests; each of
            these may be missing between two samples, and nothing else.
    """

    rate_hz = 500.0
    parts: Sequence[int] = (1, 7, 40, 300)
    dropped: Sequence[str] = ()

    async def test_samples_come_in_order_and_nothing_is_invented(
        self, rig: StreamRig
    ) -> None:
        n = sum(self.parts)
        with rig.driver:
            deliveries = await streaming(rig, self.rate_hz)
            for part in self.parts:
                rig.emit(part)
            await deliveries.until(lambda: len(deliveries.seqs()) >= n, f"{n} samples")
            seqs, blocks = deliveries.seqs(), deliveries.of(CountSamples)
            # A missing one is marked, and has the count before it.
            status = np.concatenate([block.status[:, 0] for block in blocks])
            counts = np.concatenate([block.counts[:, 0] for block in blocks])
            is_read = status & STATUS_MISSING == 0
            steps = np.diff(counts[is_read].astype(np.int64))
            assert (steps >= 1).all()
            # What a board's full queue has dropped is missing from its numbers.
            gaps = np.diff(np.array(seqs)[is_read])
            if missing := int(np.maximum(steps - gaps, 0).sum()):
                await deliveries.until(
                    lambda: (
                        sum(
                            counters.values.get(name, 0)
                            for counters in deliveries.of(DeviceCounters)[-1:]
                            for name in self.dropped
                        )
                        >= missing
                    ),
                    f"{missing} samples less, counted",
                )
        assert (np.diff(seqs) >= 1).all()
        assert seqs[0] >= 0
        stream = deliveries.of(StreamStarted)[0].stream
        assert {block.stream for block in blocks} == {stream}
        # A clock that was off, on a busy machine, may be set back: marked.
        status = np.concatenate([block.status for block in blocks])
        times_ns = np.concatenate([block.sample_time_ns for block in blocks])
        is_known = ~(status & STATUS_TIME_UNCERTAIN).any(axis=1)
        assert (np.diff(times_ns[is_known]) >= 0).all()
        identity = deliveries.of(DeviceUp)[0].identity
        for block in blocks:
            shape = (len(block.seq), len(identity.moduli_counts))
            assert block.counts.shape == block.status.shape == shape
            assert block.skew_ns is None or block.skew_ns.shape == shape
            assert block.fractions is None
            assert (block.counts < np.array(identity.moduli_counts)).all()
            assert (block.sample_time_ns <= block.received_ns).all()

    async def test_what_is_lost_on_the_line_is_counted_and_seen(
        self, rig: StreamRig
    ) -> None:
        with rig.driver:
            deliveries = await streaming(rig, self.rate_hz)
            rig.emit(5)
            await deliveries.until(lambda: len(deliveries.seqs()) >= 5, "5 samples")
            rig.lose(3)
            rig.emit(5)
            await deliveries.until(
                lambda: missing_samples(deliveries.of(CountSamples)) >= 3, "the loss"
            )
            await deliveries.until(
                lambda: reported_losses(deliveries) >= 3, "its count"
            )
        assert missing_samples(deliveries.of(CountSamples)) >= 3

    async def test_the_stream_continues_after_an_outage(self, rig: StreamRig) -> None:
        with rig.driver:
            deliveries = await streaming(rig, self.rate_hz)
            await unplugged(rig, deliveries)
            first, n_started = (
                deliveries.of(StreamStarted)[0],
                len(deliveries.of(StreamStarted)),
            )
            rig.plug()
            await deliveries.until(
                lambda: len(deliveries.of(StreamStarted)) > n_started, "its stream"
            )
            second = deliveries.of(StreamStarted)[-1]
            rig.emit(3)
            await deliveries.until(
                lambda: (
                    deliveries.of(CountSamples)
                    and deliveries.of(CountSamples)[-1].stream == second.stream
                ),
                "samples again",
            )
        assert second.stream != first.stream
        ups = deliveries.of(DeviceUp)
        for up, started in ((ups[0], first), (ups[-1], second)):
            # A busy computer may find a line slower than it did before.
            assert up.identity is not None
            expected_hz = min(self.rate_hz, up.identity.max_rate_hz)
            assert started.rate_hz == pytest.approx(expected_hz, rel=1e-9)


def reported_losses(deliveries: Deliveries) -> int:
    """Count samples or readings that the driver reports as lost."""
    codes = ("samples_lost", "readings_missing")
    faults = [fault for fault in deliveries.of(DeviceFault) if fault.code in codes]
    # Several in a row become an alarm instead, which says how many they are.
    alarms = [a for a in deliveries.of(DeviceAlarm) if a.code == "encoder_missing"]
    return sum(f.count for f in faults) + sum(a.value for a in alarms if a.raised)


class EdgeContract:
    """Drivers with inputs."""

    async def test_edges_come_once_and_in_order(self, rig: EdgeRig) -> None:
        with rig.driver:
            deliveries = await up(rig)
            tokens = [rig.press() for _ in range(3)]
            await deliveries.until(
                lambda: len(deliveries.of(LatchedCounts)) >= 3, "3 edges"
            )
        latches = deliveries.of(LatchedCounts)
        assert len(latches) == 3
        numbers = [latch.token for latch in latches]
        assert len(set(numbers)) == 3
        assert all(t in (None, got) for t, got in zip(tokens, numbers, strict=True))
        times_ns = [latch.sample_time_ns for latch in latches]
        assert times_ns == sorted(times_ns)
        identity = deliveries.of(DeviceUp)[0].identity
        n = len(identity.moduli_counts) if identity.latches else 0
        for latch in latches:
            assert latch.input in range(identity.inputs)
            assert len(latch.counts) == len(latch.status)
            assert len(latch.counts) in (n, len(identity.moduli_counts))
            assert latch.sample_time_ns <= latch.received_ns


class KeptEdgeContract(EdgeContract):
    """Drivers of devices that keep edges until they are acknowledged."""

    async def test_edges_come_once_however_often_they_are_sent(
        self, rig: KeptEdgeRig
    ) -> None:
        with rig.driver:
            deliveries = await up(rig)
            tokens = [rig.press() for _ in range(3)]
            await deliveries.until(
                lambda: len(deliveries.of(LatchedCounts)) >= 3, "3 edges"
            )
            rig.emit(2)  # the device has repeated them meanwhile
            await deliveries.until(
                lambda: len(deliveries.seqs()) >= 2, "samples after them"
            )
            assert rig.unacknowledged() == set(tokens)  # none is acknowledged
            rig.driver.acknowledge(tokens[1])
            await until(lambda: rig.unacknowledged() == {tokens[2]}, "two forgotten")
            rig.driver.acknowledge(tokens[2])
            await until(lambda: not rig.unacknowledged(), "all forgotten")
        assert [latch.token for latch in deliveries.of(LatchedCounts)] == tokens

    async def test_a_broken_edge_does_not_change_the_order(
        self, rig: KeptEdgeRig
    ) -> None:
        with rig.driver:
            deliveries = await up(rig)
            rig.break_next()
            tokens = [rig.press(), rig.press()]
            await deliveries.until(
                lambda: len(deliveries.of(LatchedCounts)) >= 2, "2 edges"
            )
        assert [latch.token for latch in deliveries.of(LatchedCounts)] == tokens

    async def test_an_edge_during_an_outage_is_delivered_afterwards(
        self, rig: KeptEdgeRig
    ) -> None:
        with rig.driver:
            deliveries = await up(rig)
            await unplugged(rig, deliveries)
            token = rig.press()
            rig.plug()
            await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
        assert [latch.token for latch in deliveries.of(LatchedCounts)] == [token]


class LatchContract:
    """Drivers that latch on request."""

    async def test_a_latch_by_request_brings_its_token(self, rig: Rig) -> None:
        with rig.driver:
            deliveries = await up(rig)
            tokens = [rig.driver.request_latch() for _ in range(3)]
            await deliveries.until(
                lambda: len(deliveries.of(LatchedCounts)) >= 3, "3 latches"
            )
        latches = deliveries.of(LatchedCounts)
        assert [latch.token for latch in latches] == tokens
        assert {latch.input for latch in latches} == {None}
        assert deliveries.of(DeviceUp)[0].identity.latches

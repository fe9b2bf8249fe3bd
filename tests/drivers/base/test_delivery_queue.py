import asyncio
import threading
from collections.abc import Callable

import numpy as np
import pytest

from traverse.drivers.base.delivery_queue import (
    BATCH_WINDOW_NS,
    RESERVED_FOR_STATES,
    DeliveryQueue,
)
from traverse.drivers.base.values import (
    CountSamples,
    DeviceFault,
    DeviceLost,
    LatchedCounts,
)


def samples(n: int, first: int = 0) -> CountSamples:
    numbers = np.arange(first, first + n)
    return CountSamples(
        "base",
        1,
        numbers,
        numbers,
        0,
        numbers,
        np.zeros(n, np.uint8),
        np.zeros((n, 1), np.uint32),
        np.zeros((n, 1), np.uint8),
    )


FAULT = DeviceFault("base", "some", "text", "remedy")
LATCH = LatchedCounts("base", 0, True, 0, 0, 0, 0, (1,), (0,))
LOST = DeviceLost("base", "unplugged", "plug it in")


class Clock:
    def __init__(self) -> None:
        self.now_ns = 10**12

    def __call__(self) -> int:
        return self.now_ns


async def crossing_of(**limits: int) -> tuple[DeliveryQueue, Clock]:
    clock = Clock()
    return DeliveryQueue(
        asyncio.get_running_loop(), monotonic_ns=clock, **limits
    ), clock


async def test_what_is_put_in_a_thread_is_taken_in_order():
    delivery_queue, _ = await crossing_of()
    deliveries = [samples(3), LATCH, samples(2, 3), FAULT]
    thread = threading.Thread(
        target=lambda: [delivery_queue.put(samples) for samples in deliveries]
    )
    thread.start()
    thread.join()
    assert await delivery_queue.take() == deliveries
    assert delivery_queue.waiting_samples == 0


async def test_what_wakes_nobody_waits_for_the_next_or_to_be_asked_for():
    delivery_queue, _ = await crossing_of()
    batches: list[list[object]] = []
    with delivery_queue.notifying(
        lambda: batches.append(delivery_queue.take_waiting())
    ):
        delivery_queue.wake()  # for nothing
        assert delivery_queue.put(FAULT, wakes=False)
        await asyncio.sleep(0)
        assert batches == []
        assert delivery_queue.put(LOST)
        await asyncio.sleep(0)
        assert batches == [[FAULT, LOST]]
        assert delivery_queue.put(FAULT, wakes=False)
        delivery_queue.wake()
        delivery_queue.wake()
        await asyncio.sleep(0)
        assert batches == [[FAULT, LOST], [FAULT]]
        delivery_queue.always_wakes = True
        assert delivery_queue.put(FAULT, wakes=False)
        await asyncio.sleep(0)
        assert len(batches) == 3


async def test_samples_beyond_the_bound_are_dropped_and_counted():
    delivery_queue, _ = await crossing_of(max_samples=10)
    assert delivery_queue.put(samples(6))
    assert not delivery_queue.put(samples(5))
    assert delivery_queue.put(samples(4))
    assert not delivery_queue.put(samples(1))
    assert delivery_queue.waiting_samples == 10
    assert delivery_queue.dropped_samples == 6
    assert [len(block.seq) for block in await delivery_queue.take()] == [10]
    assert delivery_queue.put(samples(10))  # there is room again


async def test_after_a_stall_samples_come_in_blocks_of_a_bounded_length():
    delivery_queue, _ = await crossing_of()
    blocks = [samples(180, 180 * k) for k in range(7)]
    assert all(
        delivery_queue.put(delivery) for delivery in [*blocks[:4], FAULT, *blocks[4:]]
    )
    deliveries = await delivery_queue.take()
    assert [len(delivery.seq) for delivery in deliveries if delivery is not FAULT] == [
        360,
        360,
        360,
        180,
    ]
    assert deliveries[2] is FAULT
    numbers = np.concatenate(
        [delivery.seq for delivery in deliveries if delivery is not FAULT]
    )
    np.testing.assert_array_equal(numbers, np.arange(7 * 180))


async def test_reports_beyond_the_bound_are_dropped_and_latches_refused():
    delivery_queue, _ = await crossing_of(max_others=2)
    assert delivery_queue.put(FAULT)
    assert delivery_queue.put(LATCH)
    assert not delivery_queue.put(FAULT)
    assert not delivery_queue.put(LATCH)
    assert (
        delivery_queue.dropped_others == 1
    )  # the latch is refused: the board keeps it
    assert await delivery_queue.take() == [FAULT, LATCH]


async def test_changes_of_state_have_room_where_reports_have_none():
    delivery_queue, _ = await crossing_of(max_others=1)
    assert delivery_queue.put(FAULT)
    assert all(delivery_queue.put(LOST) for _ in range(RESERVED_FOR_STATES))
    assert not delivery_queue.put(LOST)


async def test_full_of_samples_still_takes_edges():
    delivery_queue, _ = await crossing_of(max_samples=1)
    assert delivery_queue.put(samples(1))
    assert delivery_queue.put(LATCH)


class Loop:
    """Stand-in for the event loop that counts how often it is woken."""

    def __init__(self) -> None:
        self.woken = 0

    def call_soon_threadsafe(self, callback: Callable[[], object]) -> None:
        self.woken += 1
        callback()

    def call_later(self, delay_s: float, callback: Callable[[], object]) -> None:
        callback()


async def test_samples_wake_the_loop_seldom_and_everything_else_at_once():
    loop, clock = Loop(), Clock()
    delivery_queue = DeliveryQueue(loop, monotonic_ns=clock)
    delivery_queue.put(samples(1))
    assert loop.woken == 1
    await delivery_queue.take()
    clock.now_ns += 4 * BATCH_WINDOW_NS // 5 - 1
    delivery_queue.put(samples(1))
    assert loop.woken == 1  # gathered
    delivery_queue.put(LATCH)
    assert loop.woken == 2
    await delivery_queue.take()
    clock.now_ns += 4 * BATCH_WINDOW_NS // 5
    delivery_queue.put(samples(1))
    assert loop.woken == 3
    await delivery_queue.take()
    delivery_queue.batch_window_ns = 10_000_000  # a consumer requests them sooner
    clock.now_ns += 8_000_000
    delivery_queue.put(samples(1))
    assert loop.woken == 4


async def test_a_loop_that_has_been_woken_is_not_woken_again_before_it_comes():
    loop = Loop()
    delivery_queue = DeliveryQueue(loop, monotonic_ns=Clock())
    deliveries = [LATCH, FAULT, LATCH]
    for samples in deliveries:
        delivery_queue.put(samples)
    assert loop.woken == 1
    assert await delivery_queue.take() == deliveries
    delivery_queue.put(LATCH)
    assert loop.woken == 2


async def test_what_is_put_together_wakes_the_loop_once_and_at_its_end():
    loop = Loop()
    delivery_queue = DeliveryQueue(loop, monotonic_ns=Clock())
    with delivery_queue.together():
        delivery_queue.put(LATCH)
        delivery_queue.put(FAULT)
        assert loop.woken == 0
    assert loop.woken == 1
    assert await delivery_queue.take() == [LATCH, FAULT]
    with delivery_queue.together():
        pass
    assert loop.woken == 1


async def test_a_consumer_is_called_also_for_what_waited_before_it_came():
    delivery_queue = DeliveryQueue(Loop(), monotonic_ns=Clock())
    deliveries = []

    def take() -> None:
        deliveries.extend(delivery_queue.take_waiting())

    delivery_queue.put(FAULT)
    with delivery_queue.notifying(take):
        assert deliveries == [FAULT]
        delivery_queue.put(LATCH)
        assert deliveries == [FAULT, LATCH]
    delivery_queue.put(LOST)
    assert deliveries == [FAULT, LATCH]
    assert delivery_queue.is_due


def test_a_closed_loop_does_not_hurt_the_reader():
    loop = asyncio.new_event_loop()
    delivery_queue = DeliveryQueue(loop)
    loop.close()
    assert not delivery_queue.put(LATCH)


async def test_taking_waits_until_there_is_something():
    delivery_queue, _ = await crossing_of()
    taking = asyncio.create_task(delivery_queue.take())
    await asyncio.sleep(0)
    assert not taking.done()
    delivery_queue.put(FAULT)
    assert await taking == [FAULT]
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.01):
            await delivery_queue.take()


async def test_a_flood_of_edges_is_taken_in_few_turns_and_none_is_lost():
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())

    def flood() -> None:
        for _ in range(200):
            while not delivery_queue.put(LATCH):
                pass

    thread = threading.Thread(target=flood)
    thread.start()
    deliveries = []
    while len(deliveries) < 200:
        deliveries += await delivery_queue.take()
    thread.join()
    assert deliveries == [LATCH] * 200
    assert delivery_queue.taken < 100

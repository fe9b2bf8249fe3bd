import asyncio
import contextlib
import itertools
from typing import Self

from tests.drivers.canopen.fake_nodes import FakeNodes
from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import CountSamples, DeviceAlarm
from traverse.drivers.canopen.driver import CanOpenDriver
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.testing.deliveries import Deliveries

channels = itertools.count()


class CanRig:
    """A driver with an external source of SYNCs, which the test controls.

    Nodes are plugged in until the end of a context, or until it is closed.
    """

    def __init__(self, **options: object) -> None:
        channel = f"bus-{next(channels)}"
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        self.nodes = FakeNodes(channel)
        self.port = f"virtual:{channel}"
        driver_options = {
            "interface": "virtual",
            "channel": channel,
            "nodes": (5, 9),
            "sync": "external",
            "heartbeat_ms": 100,
            "answer_s": 0.1,
            "answer_tries": 2,
            "status_period_s": 0.0,
        } | options
        self.driver = CanOpenDriver(
            "arm", CanOpenOptions(**driver_options), self.delivery_queue
        )
        self.plug, self.unplug = self.nodes.plug, self.nodes.unplug
        self.plug()

    def emit(self, n: int) -> None:
        self.nodes.sync(n)

    def lose(self, n: int) -> None:
        self.nodes.sync(n, lost=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.driver.close()
        self.nodes.unplug()


def alarms(deliveries: Deliveries, code: str) -> list[tuple[int | None, bool]]:
    raised = [alarm for alarm in deliveries.of(DeviceAlarm) if alarm.code == code]
    assert all(alarm.remedy and alarm.text for alarm in raised)
    return [(alarm.channel, alarm.raised) for alarm in raised]


def last_status(deliveries: Deliveries) -> list[int]:
    blocks = deliveries.of(CountSamples)
    return blocks[-1].status[-1].tolist() if blocks else []


async def until_status(rig: CanRig, deliveries: Deliveries, status: list[int]) -> None:
    async with asyncio.timeout(8):
        while last_status(deliveries) != status:
            await answered(rig, deliveries)


async def answered(rig: CanRig, deliveries: Deliveries) -> None:
    rig.emit(1)
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(0.03):  # samples alone need not wake it
            deliveries.all += await rig.delivery_queue.take()

"""Follows one arm for all open pages, and carries their commands out."""

import asyncio
import contextlib
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable

from traverse.client.arm import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.display.arm_state import ArmSight, Change
from traverse.client.display.point_cloud import Cloud
from traverse.client.errors import BrokerUnreachableError, ClientError, CommandRefused
from traverse.client.mqtt.address import BrokerAddress

log = logging.getLogger(__name__)

LOOK_S = 0.2
AGAIN_S = 1.0
PATIENCE_S = 5.0


class Follower:
    """One connection to one arm, shared by all pages.

    Args:
        name: of the arm.
        broker: where it reports to.

    Attributes:
        sight: what is known of the arm.
        cloud: of scanned points.
        broker: as given.
    """

    def __init__(self, name: str, broker: BrokerAddress) -> None:
        self.name = name
        self.broker = broker
        self.sight = ArmSight(time.monotonic)
        self.cloud = Cloud()
        self._arm: Arm | None = None
        self._scan = ""

    async def run(self) -> None:
        """Follow until cancelled; reconnects after every failure."""
        while True:
            try:
                async with (
                    Arm(
                        self.name,
                        self.broker,
                        since="now",
                        patience_s=PATIENCE_S,
                    ) as arm,
                    asyncio.TaskGroup() as tasks,
                ):
                    self._arm = arm
                    tasks.create_task(self._lives(arm))
                    tasks.create_task(self._points(arm))
                    tasks.create_task(self._events(arm))
                    tasks.create_task(self._scans(arm))
                    tasks.create_task(self._states(arm))
            except BrokerUnreachableError as error:
                self.sight.take_link(False, str(error))
            except BaseExceptionGroup as group:
                _, others = group.split((ClientError, OSError))
                if others is not None:
                    raise
                self.sight.take_link(False, str(group.exceptions[0]))
            finally:
                self._arm = None
            await asyncio.sleep(AGAIN_S)

    async def do(self, act: Callable[[Arm], Awaitable[object]]) -> str:
        """Carry a command out; gives why not, for people, or an empty text."""
        if self._arm is None or not self._arm.is_connected:
            return self._said("There is no connection to the broker.")
        try:
            await act(self._arm)
        except CommandRefused as error:
            remedy = f" {error.remedy}." if error.remedy else ""
            return self._said(f"{error.text}.{remedy}")
        except ClientError as error:
            return self._said(str(error))
        return ""

    def _said(self, reason: str) -> str:
        for listener in list(self.sight.listeners):
            listener(Change("refused", reason))
        return reason

    async def _lives(self, arm: Arm) -> None:
        async for live in arm.live():
            self.sight.take_live(live)

    async def _points(self, arm: Arm) -> None:
        async for point in arm.points():
            self.sight.take_point(point)
            self.sight.lost_points = arm.counters.lost

    async def _events(self, arm: Arm) -> None:
        async for event in arm.events():
            self.sight.take_event(event)

    async def _scans(self, arm: Arm) -> None:
        async for scan in await arm.scans():
            if scan.scan != self._scan:
                self._scan = scan.scan
                self.cloud.clear()
            self.sight.scan = scan
            self.cloud.add(scan.xyz_mm)

    async def _states(self, arm: Arm) -> None:
        """What has no queue: the connection, the latest state and figures."""
        while True:
            reason = "" if arm.is_connected else "it was there and is gone"
            self.sight.take_link(arm.is_connected, reason)
            with contextlib.suppress(TimeoutError):
                status = await arm.status()
                if status != self.sight.status:
                    self.sight.take_status(status)
                health = await arm.health()
                if health != self.sight.health:
                    self.sight.take_health(health)
            await asyncio.sleep(LOOK_S)


@contextlib.asynccontextmanager
async def following(follower: Follower) -> AsyncIterator[None]:
    """Follow while the block lasts."""
    task = asyncio.create_task(follower.run())
    try:
        yield
    finally:
        await cancel_tasks((task,))

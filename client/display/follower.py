"""Follows one arm for all open pages, and executes their commands."""

import asyncio
import contextlib
import logging
import time
from collections.abc import (
    AsyncIterable,
    AsyncIterator,
    Awaitable,
    Callable,
    Mapping,
    Sequence,
)
from typing import Literal, TypeVar

from traverse.arrays import Floats
from traverse.broker.address import BrokerAddress
from traverse.client.arm import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.display.arm_state import ArmSight, Change
from traverse.client.display.condition import obstacle
from traverse.client.display.point_cloud import Cloud
from traverse.client.errors import BrokerUnreachableError, ClientError, CommandRefused
from traverse.client.inspection.scan_samples import Sample
from traverse.client.mqtt.subscription import absence_of
from traverse.protocol.messages import Point

log = logging.getLogger(__name__)

T = TypeVar("T")

LOOK_S = 0.2
ABSENT_S = 2.0
AGAIN_S = 1.0
PATIENCE_S = 5.0
MOST_ASKED = 100  # points, as the command allows


class Follower:
    """One connection to one arm, shared by all pages.

    Attributes:
        sight: last known state of the arm.
    """

    def __init__(self, name: str, broker: BrokerAddress) -> None:
        self.name = name
        self.broker = broker
        self.sight = ArmSight(time.monotonic)
        self.cloud = Cloud()
        self.sight.scan_listeners.append(self.cloud.take)
        self.sight.doubt_listeners.append(self.cloud.doubt)
        self._arm: Arm | None = None
        self._scan = ""
        self._undoing = asyncio.Lock()

    async def run(self) -> None:
        since: Literal["session"] | Mapping[str, int] = "session"
        while True:
            try:
                async with (
                    Arm(
                        self.name,
                        self.broker,
                        since=since,
                        connect_timeout_s=PATIENCE_S,
                        reply_timeout_s=PATIENCE_S,
                    ) as arm,
                    asyncio.TaskGroup() as tasks,
                ):
                    self._arm = arm
                    for work in (
                        self._links(arm),
                        _each_change(arm.published_status, self.sight.take_status),
                        _each_change(arm.health, self.sight.take_health),
                        _each(arm.live(), self.sight.take_live),
                        _each(arm.clocks(), self.sight.take_clock),
                        _each(arm.events(), self.sight.take_event),
                        _each(arm.doubts(), self.sight.take_doubt),
                        self._points(arm),
                        self._scans(arm),
                        self._absence(),
                    ):
                        tasks.create_task(work)
            except BrokerUnreachableError as error:
                self.sight.take_link(False, str(error))
            except BaseExceptionGroup as group:
                _, unexpected = group.split((ClientError, OSError))
                if unexpected is not None:
                    raise
                self.sight.take_link(False, str(group.exceptions[0]))
            finally:
                if self._arm is not None:
                    since = self._arm.cursor or since
                self._arm = None
            await asyncio.sleep(AGAIN_S)

    async def do(
        self, act: Callable[[Arm], Awaitable[object]], *, needs_pose: bool = False
    ) -> bool:
        """Execute a command; return whether it succeeded (`sight` shows why not)."""
        reason = obstacle(self.sight, needs_pose=needs_pose)
        if reason or self._arm is None:
            self.sight.refuse("this is not possible now", reason)
            return False
        try:
            await act(self._arm)
        except CommandRefused as error:
            self.sight.refuse(error.text, error.remedy)
        except ClientError as error:
            self.sight.refuse(str(error))
        else:
            return True
        return False

    async def shared_errors(
        self, points: Sequence[Point]
    ) -> Mapping[str, Floats] | str:
        """Return what points and samples share by the arm, or why it is unknown."""
        shared: dict[str, Floats] = {}
        for is_sample in (False, True):
            every = [p for p in points if isinstance(p, Sample) is is_sample]
            for start in range(0, len(every), MOST_ASKED):
                requested = every[start : start + MOST_ASKED]
                if self._arm is None:
                    return "there is no connection to the arm"
                try:
                    factors = (
                        await self._arm.shared_errors(requested)
                        if is_sample
                        else (await self._arm.covariance(requested)).shared_mm
                    )
                except CommandRefused as error:
                    return error.text
                except ClientError as error:
                    return str(error)
                ids = [point.id for point in requested]
                shared |= dict(zip(ids, factors, strict=True))
        return shared

    async def undo_shown(self) -> None:
        """Retract the last point that is shown, and no later one.

        Returns once the retraction has arrived, so that a second call retracts the
        point before it.
        """
        async with self._undoing:
            last = self.sight.last_point
            point_id = None if last is None else last.id
            arrived = asyncio.Event()

            def look(change: Change) -> None:
                if change.point is not None and change.point.retracts == point_id:
                    arrived.set()

            self.sight.listeners.append(look)
            try:
                if await self.do(lambda arm: arm.undo(point_id)):
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(arrived.wait(), PATIENCE_S)
            finally:
                self.sight.listeners.remove(look)

    async def turn_scan(self, spacing_mm: float | None = None) -> None:
        """Stop the running scan, or start one, by time or with a spacing."""
        runs = self.sight.scan is not None and self.sight.scan.runs

        async def turn(arm: Arm) -> None:
            if runs:
                await arm.stop_scan()
            else:
                started = await (
                    arm.start_scan()
                    if spacing_mm is None
                    else arm.start_scan("distance", spacing_mm=spacing_mm)
                )
                self.sight.scan_started(started.scan)

        await self.do(turn, needs_pose=not runs)

    async def _points(self, arm: Arm) -> None:
        async for point in arm.points():
            self.sight.lost_points = arm.counters.lost
            self.sight.take_point(point)

    async def _scans(self, arm: Arm) -> None:
        async for scan in await arm.scans():
            if scan.scan != self._scan:
                self._scan = scan.scan
                self.cloud.clear()
            self.sight.take_scan(scan)

    async def _links(self, arm: Arm) -> None:
        while True:
            reason = "" if arm.is_connected else "it was there and is gone"
            self.sight.take_link(arm.is_connected, reason)
            await asyncio.sleep(LOOK_S)

    async def _absence(self) -> None:
        await asyncio.sleep(ABSENT_S)
        if self.sight.status is None:
            # A lost broker is reported elsewhere.
            with contextlib.suppress(ClientError):
                self.sight.take_absence(
                    await absence_of(self.name, self.broker, ABSENT_S)
                )


async def _each(feed: AsyncIterable[T], take: Callable[[T], None]) -> None:
    async for message in feed:
        take(message)


async def _each_change(
    read: Callable[[], Awaitable[T]], take: Callable[[T], None]
) -> None:
    """Read the latest message of a kind repeatedly, and take new ones."""
    known: T | None = None
    while True:
        with contextlib.suppress(TimeoutError):
            if (message := await read()) != known:
                known = message
                take(message)
        await asyncio.sleep(LOOK_S)


@contextlib.asynccontextmanager
async def following(follower: Follower) -> AsyncIterator[None]:
    task = asyncio.create_task(follower.run())
    try:
        yield
    finally:
        await cancel_tasks((task,))

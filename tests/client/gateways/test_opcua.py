"""An arm as clients of OPC UA see it: read by the library's own client."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from datetime import UTC, datetime
from typing import Any

import pytest
from asyncua import Client, ua

from tests.client.display.values import doubt
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import LIVE, POINT, STATUS
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways.opcua import NAMESPACE, OpcUaServer
from traverse.protocol.messages.quality import Quality, QualityFlag
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

GOOD = Quality.from_bits(0)
SKEWED = Quality.from_bits(QualityFlag.SKEW.value)
COVARIANCE = (4e-6, 0.0, 0.0, 9e-6, 0.0, 16e-6)


class Bench:
    """A virtual arm, a server, and a client that subscribes to all that it serves.

    Attributes:
        values: the newest data of each variable, by its path below the arm.
    """

    def __init__(self, virtual: VirtualDaemon, client: Client, index: int) -> None:
        self.virtual, self.client, self.index = virtual, client, index
        self.values: dict[str, ua.DataValue] = {}
        self.events: list[Any] = []
        self._paths: dict[Any, str] = {}

    async def subscribe(self) -> None:
        subscription = await self.client.create_subscription(20, self)
        kind = f"{self.index}:PointEventType"
        kind = await self.client.nodes.base_event_type.get_child(kind)
        await subscription.subscribe_events(await self.node(), kind)
        for parent in await (await self.node()).get_children():
            for variable in await parent.get_children():
                names = [
                    (await node.read_browse_name()).Name for node in (parent, variable)
                ]
                self._paths[variable] = "/".join(names)
        await subscription.subscribe_data_change(list(self._paths))

    def event_notification(self, event: Any) -> None:
        self.events.append(event)

    def datachange_notification(self, node: Any, _value: Any, data: Any) -> None:
        self.values[self._paths[node]] = data.monitored_item.Value

    async def node(self, *path: str) -> Any:
        names = [f"{self.index}:{name}" for name in (self.virtual.arm, *path)]
        return await self.client.nodes.objects.get_child(names)

    async def becomes(self, path: str, expected: int) -> ua.DataValue:
        await until(lambda: self.code(path) == expected)
        return self.values[path]

    def code(self, path: str) -> int | None:
        data = self.values.get(path)
        return None if data is None else data.StatusCode.value

    def value(self, path: str) -> Any:
        return self.values[path].Value.Value

    async def take(self, seq: int, **values: Any) -> None:
        named = {"session": self.virtual.session, "arm": self.virtual.arm, "seq": seq}
        good = {"id": f"p{seq}", "quality": GOOD, "covariance_mm2": COVARIANCE}
        await self.virtual.publish(POINT.model_copy(update=named | good | values))

    async def say(self, message: Any, **values: Any) -> None:
        update = {"arm": self.virtual.arm, **values}
        await self.virtual.publish(message.model_copy(update=update))


@contextlib.asynccontextmanager
async def bench(virtual: VirtualDaemon, broker: str) -> AsyncIterator[Bench]:
    async with (
        virtual.running(),
        Arm(virtual.arm, broker) as arm,
        OpcUaServer(arm, "127.0.0.1", 0, print) as server,
    ):
        task = asyncio.create_task(server.serve())
        try:
            async with Client(server.address) as client:
                index = await client.get_namespace_index(NAMESPACE)
                b = Bench(virtual, client, index)
                await b.subscribe()
                yield b
        finally:
            await cancel_tasks([task])


async def test_a_points_doubt_is_the_status_code_of_its_values(virtual, broker):
    async with bench(virtual, broker) as b:
        await b.becomes("LastPoint/X", ua.StatusCodes.BadWaitingForInitialData)
        await b.take(0)
        x = await b.becomes("LastPoint/X", ua.StatusCodes.Good)
        assert x.Value.Value == POINT.xyz_mm[0]
        taken_at = datetime.fromtimestamp(POINT.time_ns / 1e9, UTC)
        late = x.SourceTimestamp.replace(tzinfo=UTC) - taken_at
        assert abs(late.total_seconds()) < 1e-4
        await until(lambda: b.code("LastPoint/Uz") == ua.StatusCodes.Good)
        assert b.value("LastPoint/Uz") == pytest.approx(8e-3)
        unit = await (await b.node("LastPoint", "X")).get_child("0:EngineeringUnits")
        assert (await unit.read_value()).UnitId == 5066068  # "MMT"

        await b.take(1, quality=SKEWED, covariance_mm2=None)
        uncertain = ua.StatusCodes.UncertainSensorNotAccurate
        await b.becomes("LastPoint/X", uncertain)
        await b.becomes("LastPoint/Doubts", uncertain)
        assert b.value("LastPoint/Doubts") == "skew"
        assert b.code("LastPoint/Ux") == ua.StatusCodes.BadNoData
        await b.take(2, part_xyz_mm=None)
        await b.becomes("LastPoint/X", ua.StatusCodes.Good)
        await b.becomes("LastPoint/PartX", ua.StatusCodes.BadNoData)
        await virtual.put_in_doubt(doubt(points="p0 p2"))
        await b.becomes("LastPoint/X", uncertain)
        await until(lambda: len(b.events) == 5)
        assert [event.Id for event in b.events[3:]] == ["p0", "p2"]
        assert {event.Severity for event in b.events[3:]} == {500}


async def test_each_point_and_what_takes_it_back_is_an_event(virtual, broker):
    async with bench(virtual, broker) as b:
        for seq in range(20):
            await b.take(seq)
        await b.take(20, quality=SKEWED)
        await b.take(21, id="r", retracts="p3")
        await until(lambda: len(b.events) == 22)
        assert [event.Sequence for event in b.events] == list(range(22))
        assert [event.X for event in b.events] == [POINT.xyz_mm[0]] * 22
        *_, doubtful, taken_back = b.events
        assert (doubtful.Severity, doubtful.Doubts) == (500, "skew")
        assert "in doubt: skew" in doubtful.Message.Text
        assert (taken_back.Retracts, taken_back.Id) == ("p3", "r")
        assert {event.Severity for event in b.events[:20]} == {100}


async def test_state_and_pose_follow_the_arm_and_are_bad_when_it_is_away(
    virtual, broker
):
    async with bench(virtual, broker) as b:
        await b.say(STATUS)
        (alarm,) = STATUS.alarms
        expected = [f"{alarm.source}: {alarm.text}; {alarm.remedy}"]
        await b.becomes("State/Alarms", ua.StatusCodes.Good)
        await until(lambda: b.value("State/Alarms") == expected)

        def shown() -> bool:
            return b.code("LivePose/X") == ua.StatusCodes.Good

        while not shown():  # quality of service 0 may come too early
            await b.say(LIVE, quality=GOOD)
            await asyncio.sleep(0.05)
        assert b.value("LivePose/X") == LIVE.xyz_mm[0]
        # Nothing has come for a second: nobody knows where it is now.
        await b.becomes("LivePose/X", ua.StatusCodes.UncertainLastUsableValue)
        await b.say(STATUS, online=False, state="offline", alarms=())
        await b.becomes("LivePose/X", ua.StatusCodes.BadNoCommunication)
        await until(lambda: b.value("State/Online") is False)
        await b.becomes("State/Devices", ua.StatusCodes.BadNoCommunication)


async def test_a_daemon_that_stands_still_is_no_good_state(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with bench(virtual, broker) as b:
        await b.becomes("State/State", ua.StatusCodes.Good)
        assert b.value("State/State") == "ready"
        virtual.is_stopped = True
        await b.becomes("State/Probe", ua.StatusCodes.UncertainLastUsableValue)
        assert b.value("State/Online") is False
        assert b.value("State/State") == "offline"
        await b.becomes("State/Devices", ua.StatusCodes.BadNoCommunication)
        virtual.is_stopped = False
        await b.becomes("State/Probe", ua.StatusCodes.Good)
        await until(lambda: b.value("State/State") == "ready")


async def test_a_client_writes_nothing_and_adds_nothing(virtual, broker):
    async with bench(virtual, broker) as b:
        await b.take(0)
        await b.becomes("LastPoint/X", ua.StatusCodes.Good)
        for name in ("X", "Id"):
            node = await b.node("LastPoint", name)
            with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
                await node.write_value(await node.read_value())
        with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
            await b.client.nodes.objects.add_object(0, "mine")

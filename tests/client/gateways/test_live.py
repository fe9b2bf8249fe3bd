import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator
from typing import Any

import jsonschema
import numpy as np
import pytest

from tests.client.display.values import doubt as later_doubt
from tests.client.gateways.foxglove_viewer import Viewer
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import EVENT, HEALTH, LIVE, POINT, SCAN, STATUS
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.gateways import live
from traverse.client.gateways.live import LiveServer
from traverse.kinematics.model.quaternion import rotation_matrix
from traverse.protocol.messages import Point
from traverse.protocol.messages.quality import Quality
from traverse.recording.views import CLOUD_TYPE, bytes_to_cloud
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

GOOD = Quality.from_bits(0)
# Standard deviations 4, 20 and 100 um along turned axes.
AXES = rotation_matrix(np.array([0.8, 0.4, -0.4, 0.2]))
COVARIANCE = AXES @ np.diag(np.array([4e-3, 20e-3, 100e-3]) ** 2) @ AXES.T
UPPER = COVARIANCE[np.triu_indices(3)]


class Bench:
    def __init__(self, virtual: VirtualDaemon, server: LiveServer) -> None:
        self.virtual, self.server = virtual, server
        self.reports: list[str] = []

    async def take(self, seq: int, **values: Any) -> Point:
        named = {"session": self.virtual.session, "arm": self.virtual.arm, "seq": seq}
        good = {"id": f"p{seq}", "quality": GOOD, "covariance_mm2": tuple(UPPER)}
        point = POINT.model_copy(update=named | good | values)
        await self.virtual.publish(point)
        return point

    async def say(self, message: Any, **values: Any) -> None:
        update = {"arm": self.virtual.arm, **values}
        await self.virtual.publish(message.model_copy(update=update))


@contextlib.asynccontextmanager
async def bench(
    virtual: VirtualDaemon, broker: str, times: float = 1.0, **described: Any
) -> AsyncIterator[Bench]:
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        server = LiveServer(arm, "127.0.0.1", 0, times, print, **described)
        async with server:
            task = asyncio.create_task(server.serve())
            try:
                yield Bench(virtual, server)
            finally:
                await cancel_tasks([task])


def entities(viewer: Viewer, topic: str) -> dict[str, Any]:
    """Entities of a scene that a viewer still shows."""
    shown: dict[str, Any] = {}
    for update in viewer.messages.get(topic, ()):
        for entity in update.get("deletions", ()):
            shown.pop(entity["id"], None)
        shown |= {entity["id"]: entity for entity in update.get("entities", ())}
    return shown


def xyz(table: dict[str, float]) -> list[float]:
    return [table.get(axis, 0.0) for axis in "xyz"]  # protobuf leaves zeros out


def covariance_of(sphere: dict[str, Any]) -> np.ndarray:
    """The covariance that an ellipsoid of k = 2 shows, mm^2."""
    turn = sphere["pose"]["orientation"]
    axes = rotation_matrix(np.array([turn.get("w", 0.0), *xyz(turn)]))
    sigma_mm = np.array(xyz(sphere["size"])) * 1e3 / 2 / 2
    return axes @ np.diag(sigma_mm**2) @ axes.T


@pytest.mark.parametrize("times", [1.0, 50.0])
async def test_a_point_has_its_place_and_its_ellipsoid_to_scale(
    times: float, virtual: VirtualDaemon, broker: str
) -> None:
    async with bench(virtual, broker, times) as b, Viewer(b.server.address) as viewer:
        await until(lambda: viewer.newest("points") is not None)
        good = await b.take(0)
        doubtful = await b.take(1, quality=POINT.quality)
        await until(lambda: len(entities(viewer, "points")) == 2)
        shown = entities(viewer, "points")
        trusted, in_doubt = shown["p0"], shown["p1"]
        (ellipsoid,) = trusted["spheres"]
        place_mm = np.array(xyz(ellipsoid["pose"]["position"])) * 1e3
        np.testing.assert_allclose(place_mm, good.xyz_mm, rtol=0, atol=1e-9)
        drawn = covariance_of(ellipsoid) / times**2
        np.testing.assert_allclose(drawn, COVARIANCE, rtol=0, atol=1e-12)
        metadata = {entry["key"]: entry.get("value") for entry in trusted["metadata"]}
        assert metadata["coverage factor k"] == "2"
        assert metadata["ellipsoid magnified"] == f"{times:g}"
        # Another colour, another shape, and the reason in words.
        (mark,), (other,) = trusted["lines"], in_doubt["lines"]
        assert mark["color"] != other["color"]
        assert (len(mark["points"]), len(other["points"])) == (6, 24)
        ends_mm = [np.array(xyz(end)) * 1e3 for end in mark["points"]]
        np.testing.assert_allclose(np.mean(ends_mm, axis=0), good.xyz_mm, atol=1e-9)
        assert "texts" not in trusted
        words = ", ".join(doubtful.quality.flags).replace("_", " ")
        assert in_doubt["texts"][0]["text"] == words

        await b.take(2, retracts="p0", id="r")
        await until(lambda: set(entities(viewer, "points")) == {"p1"})
        # Points as in a recording, and by its schemas.
        assert [shown_point["id"] for shown_point in viewer.messages["point"]] == [
            "p0",
            "p1",
            "r",
        ]
        assert len(viewer.messages["pose"]) == 2
        for topic in ("point", "pose"):
            schema = json.loads(viewer.channels[topic]["schema"])
            jsonschema.validate(viewer.newest(topic), schema)
        await b.take(3, id="p3")
        await until(lambda: "p3" in entities(viewer, "points"))
        await virtual.put_in_doubt(later_doubt(points="p3"))
        await until(lambda: "texts" in entities(viewer, "points")["p3"])
        # A late viewer sees what is shown.
        async with Viewer(b.server.address) as late:
            await until(lambda: set(entities(late, "points")) == {"p1", "p3"})


async def test_the_arm_its_scans_its_state_and_its_events_are_shown(
    virtual: VirtualDaemon, broker: str
) -> None:
    async with bench(virtual, broker) as b, Viewer(b.server.address) as viewer:
        await until(lambda: viewer.newest("status") is not None)
        # What has quality of service 0 may be sent before it is subscribed to.
        while not (viewer.newest("arm") and viewer.newest("cloud")):
            await b.say(LIVE, covariance_mm2=tuple(UPPER))
            await b.say(SCAN)
            await asyncio.sleep(0.05)
        arm = entities(viewer, "arm")["arm"]
        (links,) = arm["lines"]
        skeleton_mm = np.array([xyz(place) for place in links["points"]]) * 1e3
        assert LIVE.skeleton_mm is not None
        np.testing.assert_allclose(skeleton_mm, LIVE.skeleton_mm, atol=1e-9)
        *joints, ball, ellipsoid = arm["spheres"]
        assert len(joints) == len(LIVE.skeleton_mm) - 1
        assert xyz(ball["size"]) == pytest.approx([2e-3 * LIVE.probe_radius_mm] * 3)
        drawn = covariance_of(ellipsoid)
        np.testing.assert_allclose(drawn, COVARIANCE, rtol=0, atol=1e-12)

        cloud = viewer.newest("cloud")
        jsonschema.validate(cloud, json.loads(viewer.channels["cloud"]["schema"]))
        read = bytes_to_cloud(json.dumps(cloud).encode())
        assert (read.scan, read.points.dtype) == (SCAN.scan, CLOUD_TYPE)
        np.testing.assert_array_equal(read.points["x_mm"], SCAN.xyz_mm[:, 0])

        await b.say(EVENT)
        await b.say(HEALTH)
        await until(lambda: bool(viewer.newest("log") and viewer.newest("health")))
        assert EVENT.text in viewer.newest("log")["message"]
        assert viewer.newest("health")["temperatures_c"] == {"arm": 20.5}

        await b.say(LIVE, quality=POINT.quality, session=virtual.session)
        flags = ", ".join(POINT.quality.flags).replace("_", " ")
        await until(
            lambda: (
                "texts" in (e := entities(viewer, "arm")["arm"])
                and e["texts"][0]["text"] == flags
            )
        )
        alarm = STATUS.alarms[0]
        await b.say(STATUS, session=virtual.session)
        name = f"{alarm.code} {alarm.source}"
        await until(lambda: name in viewer.statuses)
        assert alarm.remedy in viewer.statuses[name]["message"]
        await b.say(STATUS, alarms=(), online=False, state="offline")
        await until(lambda: set(viewer.statuses) == {"offline"})
        await until(lambda: entities(viewer, "arm") == {})
        await b.say(STATUS, session=virtual.session)
        await until(lambda: set(viewer.statuses) == {name})
        virtual.is_stopped = True
        await until(lambda: set(viewer.statuses) == {"offline"})
        assert "may be stopped" in viewer.statuses["offline"]["message"]


async def test_a_viewer_can_move_the_arms_description_by_its_joints(
    virtual: VirtualDaemon, broker: str
) -> None:
    names = [f"joint {number}" for number in range(len(LIVE.angles_rad))]
    async with (
        bench(virtual, broker, joints=names, urdf="<robot/>") as b,
        Viewer(b.server.address) as viewer,
    ):
        while not (viewer.newest("joints") and viewer.newest("tf")):
            await b.say(LIVE)
            await asyncio.sleep(0.05)
        joints = viewer.newest("joints")["joints"]
        assert [joint["name"] for joint in joints] == names
        readings = [joint.get("position", 0.0) for joint in joints]
        assert tuple(readings) == LIVE.angles_rad
        frame = viewer.newest("tf")
        assert (frame["parent_frame_id"], frame["child_frame_id"]) == ("arm", "ball")
        place_mm = np.array(xyz(frame["translation"])) * 1e3
        np.testing.assert_allclose(place_mm, LIVE.xyz_mm, rtol=0, atol=1e-9)
        turn = frame["rotation"]
        axes = rotation_matrix(np.array([turn.get("w", 0.0), *xyz(turn)]))
        np.testing.assert_allclose(axes[:, 0], LIVE.ijk, atol=1e-12)
        await viewer.fetch(1, live.ARM_ASSET)
        await viewer.fetch(2, "package://traverse/other.urdf")
        await until(lambda: len(viewer.assets) == 2)
        assert viewer.assets == {1: b"<robot/>", 2: None}


async def test_more_points_than_are_shown_let_the_oldest_go(
    virtual: VirtualDaemon, broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "MAX_POINTS", 3)
    async with bench(virtual, broker) as b, Viewer(b.server.address) as viewer:
        await until(lambda: viewer.newest("points") is not None)
        for seq in range(5):
            await b.take(seq)
        await until(lambda: set(entities(viewer, "points")) == {"p2", "p3", "p4"})


def resident_mb() -> float:
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096 / 1e6


async def test_a_viewer_that_does_not_read_costs_no_memory_and_loses_the_oldest(
    virtual: VirtualDaemon, broker: str
) -> None:
    n, size = 3000, 100_000
    async with bench(virtual, broker) as b, Viewer(b.server.address) as viewer:
        await until(lambda: viewer.newest("points") is not None)
        cloud = b.server._views["cloud"]
        before_mb = resident_mb()
        for number in range(n):  # nothing of it is read before the loop has its turn
            cloud.log({"number": number, "data": "x" * size})
        assert resident_mb() - before_mb < 0.2 * n * size / 1e6
        await until(lambda: viewer.newest("cloud") is not None)
        await until(lambda: viewer.newest("cloud")["number"] == n - 1)
        assert len(viewer.messages["cloud"]) < n / 2
        await b.take(0)
        await until(lambda: "p0" in entities(viewer, "points"))


async def test_a_port_that_is_taken_is_refused(
    virtual: VirtualDaemon, broker: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as occupied:
        port = occupied.getsockname()[1]
        server = LiveServer(Arm(virtual.arm, broker), "127.0.0.1", port, 1.0, print)
        with pytest.raises(ValueError, match=f":{port}: .*in use.*name another port"):
            async with server:
                pass

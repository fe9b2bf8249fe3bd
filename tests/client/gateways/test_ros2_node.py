"""What the node of ROS 2 publishes, in the encoding of ROS; it needs ROS itself."""

import asyncio
import importlib
import io
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer

from tests.client.exports.test_ros import read_back
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import LIVE, POINT, SCAN
from traverse.client import Arm
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.exports.ros import DEFINITIONS
from traverse.protocol.messages.quality import Quality
from traverse.testing.waiting import until

FOLDER = Path(__file__).parents[3] / "examples" / "traverse_ros2"
GOOD = Quality.from_bits(0)
# tf2_msgs/TFMessage, from ROS 2's geometry2.
RULE = "=" * 80 + "\nMSG:"
_, HEADER = DEFINITIONS["sensor_msgs/msg/JointState"].split("float64[] effort\n")
TF = f"""geometry_msgs/TransformStamped[] transforms
{RULE} geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{RULE} geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{RULE} geometry_msgs/Vector3
float64 x
float64 y
float64 z
{RULE} geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{HEADER}"""


def decoded(published) -> dict[str, list]:
    """Messages by topic, written and read by the library of the encoding."""
    file = io.BytesIO()
    writer = Writer(file)
    for message in published:
        text = {**DEFINITIONS, "tf2_msgs/msg/TFMessage": TF}[message.kind]
        schema = writer.register_msgdef(message.kind, text)
        writer.write_message(message.topic, schema, message.content, message.time_ns)
    writer.finish()
    return read_back(file)


@pytest.mark.needs("mosquitto")
async def test_poses_points_and_scans_are_published_in_metres(
    virtual: VirtualDaemon, broker: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(FOLDER))
    feed = importlib.import_module("traverse_ros2.feed").feed
    published, warnings = [], []
    async with virtual.running(), Arm(virtual.arm, broker) as arm:
        names = {"arm": virtual.arm, "session": virtual.session, "quality": GOOD}
        work = feed(arm, published.append, warnings.append, frame="base")
        task = asyncio.create_task(work)
        # What has quality of service 0 may be sent before it is subscribed to.
        while {"/tf", "scan"} - {message.topic for message in published}:
            await virtual.publish(LIVE.model_copy(update=names))
            await virtual.publish(SCAN.model_copy(update={"arm": virtual.arm}))
            await asyncio.sleep(0.05)
        for seq, update in enumerate(({}, {"quality": POINT.quality, "id": "b"})):
            point = POINT.model_copy(update=names | {"seq": seq} | update)
            await virtual.publish(point)
        undo = {"seq": 2, "retracts": "b", "id": "c"}
        await virtual.publish(POINT.model_copy(update=names | undo))
        await until(lambda: bool(warnings))
        await cancel_tasks([task])
    topics = decoded(published)
    ((_, good),), ((_, doubtful),) = topics["point"], topics["doubtful/point"]
    for point in (good, doubtful):
        place_mm = [
            1e3 * value for value in (point.point.x, point.point.y, point.point.z)
        ]
        assert place_mm == pytest.approx(POINT.xyz_mm)
        assert point.header.frame_id == "base"
    assert "takes back b" in warnings[0]
    (ball,) = topics["/tf"][0][1].transforms
    assert (ball.header.frame_id, ball.child_frame_id) == ("base", "traverse_ball")
    assert 1e3 * ball.transform.translation.z == pytest.approx(LIVE.xyz_mm[2])
    turn = ball.transform.rotation
    along = np.array([1 - 2 * (turn.y**2 + turn.z**2), 2 * turn.w * turn.z])
    np.testing.assert_allclose(along, LIVE.ijk[:2], atol=1e-12)
    assert tuple(topics["joint_states"][0][1].position) == LIVE.angles_rad
    widths = [topics[name][0][1].width for name in ("scan", "doubtful/scan")]
    assert sum(widths) == len(SCAN.xyz_mm)


def test_ros_finds_the_package() -> None:
    name = ET.parse(FOLDER / "package.xml").findtext("name")
    assert name == FOLDER.name
    assert (FOLDER / "resource" / name).is_file()
    assert f'NAME = "{name}"' in (FOLDER / "setup.py").read_text()

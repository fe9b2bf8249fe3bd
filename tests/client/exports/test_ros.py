"""Points and scans as ROS 2 messages, read back by the library of the format."""

import io

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tests.client.exports.test_formats import POINTS, SCAN
from traverse.client.exports.formats import FORMATS


def messages(write) -> dict[str, list]:
    """Messages of a file by topic, as (log time, message)."""
    file = io.BytesIO()
    with FORMATS["ros2"](file) as sink:
        write(sink)
    return read_back(file)


def read_back(file: io.BytesIO) -> dict[str, list]:
    file.seek(0)
    by_topic: dict[str, list] = {}
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, channel, record, message in reader.iter_decoded_messages():
        by_topic.setdefault(channel.topic, []).append((record.log_time, message))
    return by_topic


def test_points_are_in_metres_with_covariance_and_instant():
    by_topic = messages(lambda sink: sink.points(POINTS))
    stamped = by_topic["/traverse/point"]
    assert [time_ns for time_ns, _ in stamped] == [POINTS[0].time_ns, POINTS[2].time_ns]
    last = stamped[-1][1]
    place = [last.point.x, last.point.y, last.point.z]
    assert place == pytest.approx(np.array(POINTS[2].xyz_mm) * 1e-3, rel=1e-15)
    stamp = last.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == POINTS[2].time_ns
    ((_, pose),) = by_topic["/traverse/point_with_covariance"]
    covariance = np.array(pose.pose.covariance).reshape(6, 6)
    assert covariance[:3, :3] == pytest.approx(np.diag([4e-12, 9e-12, 1.6e-11]))
    assert not covariance[3:].any()
    assert pose.pose.pose.orientation.w == 1.0
    joints = by_topic["/traverse/joint_states"][0][1]
    assert list(joints.position) == list(POINTS[0].angles_rad)
    assert joints.name[0] == "J1"


def test_what_is_in_doubt_has_topics_of_its_own():
    by_topic = messages(lambda sink: sink.points(POINTS))
    ((time_ns, _),) = by_topic["/traverse/doubtful/point"]
    assert time_ns == POINTS[1].time_ns
    assert len(by_topic["/traverse/doubtful/point_with_covariance"]) == 1


def test_a_scan_is_clouds_of_what_is_ok_and_what_is_not():
    by_topic = messages(lambda sink: sink.table(SCAN))
    rows = []
    for topic, is_ok in (("/traverse/scan", True), ("/traverse/doubtful/scan", False)):
        ((_, cloud),) = by_topic[topic]
        kinds = {8: "<f8", 6: "<u4"}
        dtype = np.dtype(
            {
                "names": [field.name for field in cloud.fields],
                "formats": [kinds[field.datatype] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_step,
            }
        )
        points = np.frombuffer(bytes(cloud.data), dtype)
        assert len(points) == cloud.width == int((SCAN.ok == is_ok).sum())
        assert points["x"] == pytest.approx(1e-3 * SCAN.xyz_mm[SCAN.ok == is_ok, 0])
        rows += points["seq"].tolist()
    assert sorted(rows) == SCAN.seq.tolist()


def test_times_that_ros_cannot_write_are_refused():
    late = POINTS[0].model_copy(update={"time_ns": 2**31 * 10**9})
    with pytest.raises(ValueError, match="end on 19 January 2038"):
        messages(lambda sink: sink.points([late]))

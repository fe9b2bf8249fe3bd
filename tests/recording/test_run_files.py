import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from tests.protocol.message_examples import EVENT, POINT, SCAN
from traverse.protocol.messages import Scan
from traverse.recording.run_reader import RunReader
from traverse.recording.run_writer import Entry, RunHead, RunWriter
from traverse.recording.views import (
    CLOUD_FIELDS,
    COVARIANCES,
    VIEW_SCHEMAS,
    bytes_to_cloud,
    cloud_to_bytes,
    columns_of,
    log_to_bytes,
    point_to_bytes,
    pose_to_bytes,
)

HEAD = RunHead({"arm": "bench-7", "version": "1"}, {"arm.toml": b"name", "b": b""})
ENTRIES = [Entry("steps", 10**18 + i, bytes([i]) * (i % 7 + 1)) for i in range(60)]


def written(path, entries=ENTRIES, every=20):
    with RunWriter(path, HEAD) as writer:
        for number, entry in enumerate(entries):
            writer.add(entry)
            if number % every == every - 1:
                writer.flush()
    return path


def read(path):
    with RunReader(path) as reader:
        entries = list(reader)
        return reader, entries


def test_what_was_written_is_read(tmp_path):
    reader, entries = read(written(tmp_path / "a.mcap"))
    assert entries == ENTRIES
    assert reader.tear is None
    assert reader.about == {"schema": "traverse/run/1", **HEAD.about}
    assert reader.files == HEAD.files
    assert (tmp_path / "a.mcap").stat().st_mode & 0o777 == 0o600


def test_a_file_attached_in_the_middle_is_there_from_then_on(tmp_path):
    path = tmp_path / "a.mcap"
    with RunWriter(path, HEAD) as writer:
        writer.add(ENTRIES[0])
        writer.attach({"arm.toml": b"another"})
        writer.add(ENTRIES[1])
    with RunReader(path) as reader:
        steps = iter(reader)
        assert next(steps) == ENTRIES[0]
        assert reader.files["arm.toml"] == b"name"
        assert next(steps) == ENTRIES[1]
        assert reader.files["arm.toml"] == b"another"


def test_a_file_cut_at_every_byte_of_its_last_chunk_is_read_up_to_there(tmp_path):
    path = tmp_path / "a.mcap"
    writer = RunWriter(path, HEAD)
    for entry in ENTRIES[:40]:
        writer.add(entry)
    writer.flush()
    first_size = path.stat().st_size
    for entry in ENTRIES[40:]:
        writer.add(entry)
    writer.flush()
    writer.abandon()
    content = path.read_bytes()
    chunk_ends = []
    torn = tmp_path / "torn.mcap"
    for length in range(first_size, len(content)):
        torn.write_bytes(content[:length])
        reader, entries = read(torn)
        assert entries in (ENTRIES[:40], ENTRIES)
        assert reader.tear is not None
        assert reader.tear.startswith(f"torn after {reader.tear.split()[2]} bytes")
        chunk_ends.append(len(entries) == len(ENTRIES))
    # Once the chunk is whole it counts, and only its index may be torn.
    assert chunk_ends == sorted(chunk_ends)
    assert sum(chunk_ends) < 800


def test_a_file_cut_within_its_head_says_so(tmp_path):
    content = written(tmp_path / "a.mcap").read_bytes()
    torn = tmp_path / "torn.mcap"
    for length in range(0, 200, 7):
        torn.write_bytes(content[:length])
        try:
            reader, entries = read(torn)
        except ValueError:
            continue
        assert reader.tear is not None
        assert entries == []


@given(st.data())
def test_no_changed_byte_crashes_the_reader_or_changes_a_message(
    tmp_path_factory, data
):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "flips.mcap"
    if not path.exists():
        written(path)
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    changed = folder / "flipped.mcap"
    changed.write_bytes(content)
    try:
        reader, entries = read(changed)
    except ValueError:
        return
    # Topics and times may have changed outside of chunks, never what a chunk holds.
    assert [e.content for e in entries] == [e.content for e in ENTRIES[: len(entries)]]
    assert reader.tear is not None or len(entries) == len(ENTRIES)


def test_a_chunk_whose_kind_is_altered_is_missed(tmp_path):
    content = written(tmp_path / "a.mcap").read_bytes()
    chunks, place = [], 8
    while place < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, place)
        chunks += [place] * (kind == 6)
        place += 9 + length
    assert len(chunks) == 3
    for place in chunks:
        for kind in range(256):
            changed = bytearray(content)
            changed[place] = kind
            (tmp_path / "b.mcap").write_bytes(changed)
            reader, entries = read(tmp_path / "b.mcap")
            assert entries == ENTRIES[: len(entries)]
            assert (reader.tear is None) == (kind == 6)


def test_what_is_no_recording_of_a_daemon_is_refused(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"no file of this kind")
    with pytest.raises(ValueError, match="no MCAP file"):
        RunReader(path)
    other = RunHead({"schema": "traverse/recording/1"})
    RunWriter(path, other).close()
    with pytest.raises(ValueError, match="recorded by the daemon"):
        RunReader(path)


# -- for viewers ------------------------------------------------------------------


def misfits(value, schema, where=""):
    """Return misfits of a value by the part of JSON Schema that Foxglove uses."""
    if "oneOf" in schema:
        known = [branch["const"] for branch in schema["oneOf"]]
        return [] if value in known else [f"{where}: {value} is none of {known}"]
    kinds = {"object": dict, "array": list, "string": str, "integer": int}
    kind = kinds.get(schema["type"], (int, float))
    if not isinstance(value, kind) or isinstance(value, bool):
        return [f"{where}: {value!r} is no {schema['type']}"]
    mistakes = []
    if isinstance(value, dict):
        missing = set(schema.get("required", ())) - set(value)
        mistakes += [f"{where}: {name} is missing" for name in sorted(missing)]
        for name, inner in schema.get("properties", {}).items():
            if name in value:
                mistakes += misfits(value[name], inner, f"{where}.{name}")
    if isinstance(value, list):
        for item in value:
            mistakes += misfits(item, schema["items"], f"{where}[]")
    if isinstance(value, int):
        low, high = schema.get("minimum", value), schema.get("maximum", value)
        mistakes += [] if low <= value <= high else [f"{where}: {value} out of range"]
    return mistakes


VIEWS = {"pose": pose_to_bytes(POINT), "cloud": cloud_to_bytes(SCAN)}
VIEWS["log"] = log_to_bytes(EVENT)


@pytest.mark.parametrize("topic", VIEWS)
def test_views_are_what_foxgloves_schemas_say(topic):
    assert misfits(json.loads(VIEWS[topic]), VIEW_SCHEMAS[topic]) == []
    broken = json.loads(VIEWS[topic])
    del broken["timestamp"]
    assert misfits(broken, VIEW_SCHEMAS[topic]) == [": timestamp is missing"]


def test_a_pose_is_in_metres_with_its_x_axis_along_the_shank():
    pose = json.loads(VIEWS["pose"])["pose"]
    assert pose["position"]["x"] == pytest.approx(POINT.xyz_mm[0] / 1000)
    x, y, z, w = (pose["orientation"][name] for name in "xyzw")
    turned = (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w))
    assert turned == pytest.approx(POINT.ijk)
    assert x * x + y * y + z * z + w * w == pytest.approx(1)
    for ijk in ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)):
        point = POINT.model_copy(update={"ijk": ijk})
        q = json.loads(pose_to_bytes(point))["pose"]["orientation"]
        turned = (
            1 - 2 * (q["y"] ** 2 + q["z"] ** 2),
            2 * (q["x"] * q["y"] + q["z"] * q["w"]),
            2 * (q["x"] * q["z"] - q["y"] * q["w"]),
        )
        assert turned == pytest.approx(ijk)


def test_a_cloud_keeps_a_scan_to_the_last_bit():
    table = json.loads(VIEWS["cloud"])
    cloud = bytes_to_cloud(VIEWS["cloud"])
    points = cloud.points
    assert (cloud.session, cloud.scan) == (SCAN.session, SCAN.scan)
    covariance_mm2 = columns_of(points, COVARIANCES)
    assert covariance_mm2.tobytes() == np.asarray(SCAN.covariance_mm2).tobytes()
    places_mm = np.column_stack([points[f"{axis}_mm"] for axis in "xyz"])
    assert places_mm.tobytes() == np.asarray(SCAN.xyz_mm).tobytes()
    assert (points["quality"] == SCAN.quality).all()
    assert points["number"].tolist() == list(range(SCAN.seq, SCAN.seq + len(points)))
    assert table["point_stride"] == sum({7: 4, 8: 8, 5: 4}[k] for _, k in CLOUD_FIELDS)
    assert points["x"] == pytest.approx(places_mm[:, 0] / 1000, rel=1e-6)


def test_a_point_keeps_its_last_bit():
    repeated = type(POINT).model_validate_json(point_to_bytes(POINT))
    assert repeated == POINT


def test_the_reader_of_the_mcap_library_reads_all_of_it_with_its_schemas(tmp_path):
    path = tmp_path / "a.mcap"
    views = [Entry(topic, 10**18, content) for topic, content in VIEWS.items()]
    written(path, [*ENTRIES, *views, Entry("point", 10**18, point_to_bytes(POINT))])
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = list(reader.iter_messages())
        attachments = {a.name: a.data for a in reader.iter_attachments()}
    assert summary.statistics.message_count == 64
    assert attachments == HEAD.files
    by_topic = {channel.topic: (schema, channel) for schema, channel, _ in messages}
    names = {topic: s.name for topic, (s, _) in by_topic.items() if s is not None}
    assert names == {
        "pose": "foxglove.PoseInFrame",
        "cloud": "foxglove.PointCloud",
        "log": "foxglove.Log",
        "point": "traverse/point/1",
    }
    for topic in names:
        schema, channel = by_topic[topic]
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert json.loads(schema.data) == VIEW_SCHEMAS[topic]


def test_a_scan_without_points_is_a_cloud_too():
    empty = {
        name: np.asarray(getattr(SCAN, name))[:0]
        for name in ("dtime_ns", "xyz_mm", "ijk", "angles_rad", "counts", "quality")
    }
    scan = SCAN.model_copy(update={**empty, "covariance_mm2": None})
    assert isinstance(scan, Scan)
    assert len(bytes_to_cloud(cloud_to_bytes(scan)).points) == 0

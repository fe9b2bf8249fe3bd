"""Recordings: written, read back, torn, and spoilt.

Integers as differences: nothing is lost, and nothing else is read.
"""

import json
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from mcap.reader import make_reader
from mcap.writer import Writer

from tests.recording.sample_recordings import RecordingWriter
from traverse.recording.differences import bytes_to_differences, differences_to_bytes
from traverse.recording.maps import bytes_to_map, map_to_bytes
from traverse.recording.reader import read_recording
from traverse.recording.values import TIMES, Conditions, Samples, Touching
from traverse.strict_toml.problems import FileError

JOINTS = ("J1", "J2", "J3")
ARM = 'schema = "traverse/arm/1"\nname = "été"\n'
CAMPAIGN = 'schema = "traverse/campaign/1"\n'


def samples(n, first=0, seed=1):
    rng = np.random.default_rng(seed)
    numbers = np.arange(first, first + n)
    sample_time_ns = 7_000_000_000 + 1_000_000 * numbers
    return Samples(
        numbers=numbers,
        device_ticks=5000 + 1000 * numbers,
        received_ns=sample_time_ns + rng.integers(100_000, 900_000, n),
        sample_time_ns=sample_time_ns,
        utc_ns=1_795_000_000_000_000_000 + sample_time_ns,
        counts=rng.integers(0, 2**32, (n, len(JOINTS)), dtype=np.uint32),
    )


def written(path, *, n_blocks=20, size=50, chunk_bytes=4096):
    with RecordingWriter(path, JOINTS, ARM, CAMPAIGN, chunk_bytes) as writer:
        for number in range(n_blocks):
            block = samples(size, number * size, seed=number)
            at_ns = int(block.sample_time_ns[0])
            writer.add_touching(Touching(at_ns, f"cone-{number}", "1"))
            writer.add_conditions(Conditions(at_ns, 20.0 + number, None))
            writer.add_samples(block)
        writer.add_touching(Touching(at_ns + 10_000_000, None))
    return path


def test_what_was_written_is_read_back(tmp_path):
    recording = read_recording(written(tmp_path / "a.mcap"))
    expected = [samples(50, number * 50, seed=number) for number in range(20)]
    for name in (*TIMES, "counts"):
        together = np.concatenate([getattr(block, name) for block in expected])
        assert np.array_equal(getattr(recording.samples, name), together)
    assert recording.samples.counts.dtype == np.uint32
    assert (recording.joints, recording.arm_text) == (JOINTS, ARM)
    assert recording.campaign_text == CAMPAIGN
    assert recording.tear is None
    assert [t.artefact for t in recording.touching[:2]] == ["cone-0", "cone-1"]
    assert recording.touching[-1].artefact is None
    assert recording.conditions[3].temperature_c == 23.0
    assert recording.conditions[3].force_n is None


def test_other_programs_read_the_file(tmp_path):
    with written(tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {"samples", "touching", "conditions"}
        attached = {
            attachment.name: attachment.data.decode()
            for attachment in reader.iter_attachments()
        }
        assert attached == {"arm.toml": ARM, "campaign.toml": CAMPAIGN}
        (_, _, first) = next(reader.iter_messages(topics=["samples"]))
        assert first.log_time == 1_795_000_007_000_000_000
        # By hand: kind i, 8 bytes, one dimension of 50, then numbers 0, 1, ...
        content = msgpack.unpackb(first.data)["numbers"]
        assert content.code == 1
        assert content.data[:3] == b"i\x08\x01"
        assert content.data[3:7] == (50).to_bytes(4, "little")
        assert content.data[7:23] == bytes(8) + b"\x01" + bytes(7)


def test_a_file_cut_anywhere_is_readable_up_to_the_tear(tmp_path):
    content = written(tmp_path / "whole.mcap").read_bytes()
    everything = read_recording(tmp_path / "whole.mcap").samples
    torn = tmp_path / "torn.mcap"
    longest, n_lost = 0, []
    for length in range(len(content) // 2, len(content), 37):
        torn.write_bytes(content[:length])
        recording = read_recording(torn)
        n = len(recording.samples)
        assert np.array_equal(recording.samples.counts, everything.counts[:n])
        assert n >= longest
        longest = n
        assert recording.tear is not None
        assert "torn after" in recording.tear
        n_lost.append(len(everything) - n)
    assert n_lost[0] > 0 == n_lost[-1]


def test_a_writer_that_dies_loses_its_last_chunk_only(tmp_path):
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, JOINTS, ARM, chunk_bytes=4096)
    for number in range(19):
        writer.add_samples(samples(50, number * 50, seed=number))
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())
    writer.close()
    recording = read_recording(copy)
    assert recording.tear is not None
    assert 850 <= len(recording.samples) < 950
    assert recording.campaign_text is None


def test_a_flipped_bit_in_a_chunk_ends_the_reading_there(tmp_path):
    content = bytearray(written(tmp_path / "a.mcap").read_bytes())
    content[len(content) // 2] ^= 4
    (tmp_path / "b.mcap").write_bytes(content)
    recording = read_recording(tmp_path / "b.mcap")
    assert recording.tear is not None
    everything = read_recording(tmp_path / "a.mcap").samples
    n = len(recording.samples)
    assert 0 < n < len(everything)
    assert np.array_equal(recording.samples.counts, everything.counts[:n])


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_the_bytes_a_file_is_read_or_refused(tmp_path, data):
    path = tmp_path / "spoilt.mcap"
    if not (tmp_path / "a.mcap").exists():
        written(tmp_path / "a.mcap", n_blocks=4)
    content = bytearray((tmp_path / "a.mcap").read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    with suppress(FileError):
        read_recording(path)


def plain_file(path, *, profile="traverse", arm=True, metadata=None, messages=()):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile, "by hand")
        if metadata is not None:
            writer.add_metadata("traverse", metadata)
        if arm:
            writer.add_attachment(0, 0, "arm.toml", "", ARM.encode())
        channels = {
            topic: writer.register_channel(topic, "", 0)
            for topic in ("samples", "touching", "conditions", "image")
        }
        for topic, content in messages:
            writer.add_message(channels[topic], 1, content, 1)
        writer.finish()
    return path


def block(**changes):
    table = {name: integers(1) for name in TIMES}
    table["counts"] = array("u", 4, (1, 1), b"\x05\0\0\0")
    return msgpack.packb({**table, **changes})


def array(kind, size, shape, content):
    head = kind.encode() + bytes([size, len(shape)])
    head += b"".join(n.to_bytes(4, "little") for n in shape)
    return msgpack.ExtType(1, head + content)


def integers(*values):
    content = b"".join(value.to_bytes(8, "little") for value in values)
    return array("i", 8, (len(values),), content)


GOOD = {"schema": "traverse/recording/1", "joints": '["J1"]'}


def test_a_file_by_hand_is_read(tmp_path):
    moment = json.dumps({"sample_time_ns": 1, "artefact": "ball", "feature": ""})
    messages = [
        ("image", b"what is of no concern"),
        ("samples", block(status=integers(7))),
        ("touching", moment.encode()),
    ]
    path = plain_file(tmp_path / "a.mcap", metadata=GOOD, messages=messages)
    recording = read_recording(path)
    assert recording.samples.counts.tolist() == [[5]]
    assert recording.touching == (Touching(1, "ball"),)


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ({"profile": "ros1"}, "profile is 'ros1', expected 'traverse'"),
        ({"metadata": None}, "before the metadata `traverse`"),
        ({"metadata": {**GOOD, "schema": "x"}}, "schema is 'x'"),
        ({"metadata": {**GOOD, "joints": "[1]"}}, "joints are [1]"),
        ({"metadata": {**GOOD, "joints": "["}}, "joints are not JSON"),
        ({"arm": False}, "no attachment arm.toml"),
        ({"messages": []}, "no samples"),
        ({"messages": [("samples", b"\xc1")]}, "samples: not a MessagePack map"),
        ({"messages": [("samples", b"\x01")]}, "a int, expected a map"),
        ({"messages": [("samples", block(counts=3))]}, "counts is no array"),
        (
            {"messages": [("samples", block(counts=array("u", 1, (1, 2), b"\0\1")))]},
            "counts have shape (1, 2), expected (n, 1)",
        ),
        ({"messages": [("samples", block(utc_ns=integers(1, 2)))]}, "utc_ns has shape"),
        ({"messages": [("samples", block())] * 2}, "sample 2 of 2 is not later"),
        ({"messages": [("touching", b"{")]}, "Invalid JSON"),
        ({"messages": [("touching", b"{}")]}, "touching: sample_time_ns: is missing"),
        (
            {"messages": [("conditions", b'{"sample_time_ns":1,"force_n":"x"}')]},
            "force_n: 'x' is not a number",
        ),
    ],
)
def test_a_bad_file_is_refused_with_a_reason(tmp_path, file, words):
    options = {"metadata": GOOD, "messages": [("samples", block())], **file}
    path = plain_file(tmp_path / "bad.mcap", **options)
    with pytest.raises(FileError) as caught:
        read_recording(path)
    assert words in str(caught.value)
    assert "bad.mcap" in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"time_s,artefact\n" * 20])
def test_what_is_no_mcap_is_refused(tmp_path, content):
    (tmp_path / "poses.mcap").write_bytes(content)
    with pytest.raises(FileError, match="is no MCAP file"):
        read_recording(tmp_path / "poses.mcap")


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(FileError, match="check the path"):
        read_recording(tmp_path / "nothing.mcap")


def test_samples_of_other_joints_are_refused(tmp_path):
    with (
        RecordingWriter(tmp_path / "a.mcap", ("J1",), ARM) as writer,
        pytest.raises(ValueError, match="samples of 3 joints for a recording of 1"),
    ):
        writer.add_samples(samples(2))


KINDS = [f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)]
SHAPES = array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=12)


@given(st.data(), st.sampled_from(KINDS), SHAPES)
def test_any_integers_come_back(data, kind, shape):
    array = data.draw(arrays(kind, shape))
    restored = bytes_to_differences(differences_to_bytes(array))
    assert restored.dtype == array.dtype
    assert restored.shape == array.shape
    assert (restored == array).all()


def test_bytes_are_those_of_the_table():
    # Two columns; rows 100 7, 101 5, 103 3: differences 1 2 and -2 -2 in one byte.
    array = np.array([[100, 7], [101, 5], [103, 3]], np.uint32)
    head = bytes([ord("u"), 4, 2, 1, 3, 0, 0, 0, 2, 0, 0, 0])
    first = bytes([100, *[0] * 7, 7, *[0] * 7])
    assert differences_to_bytes(array) == head + first + bytes([1, 2, 254, 254])
    steady = np.arange(1000, 2000, 10)
    assert len(differences_to_bytes(steady)) == 12 + 8 + 8  # w = 0


def test_a_stream_takes_few_bytes():
    rng = np.random.default_rng(3)
    n = 200
    counts = np.cumsum(rng.integers(-90, 90, (n, 7)), axis=0) % (1 << 23)
    assert len(differences_to_bytes(counts.astype(np.uint32))) < n * 7 * 4.3
    steady = np.cumsum(rng.integers(-90, 90, (n, 7)), axis=0) + (1 << 20)
    assert len(differences_to_bytes(steady.astype(np.uint32))) < n * 7 * 1.2


@given(st.binary(max_size=80))
def test_no_bytes_crash_the_reader(content):
    try:
        bytes_to_differences(content)
    except ValueError:
        return


@given(st.data())
def test_a_changed_array_is_read_or_refused(data):
    content = bytearray(differences_to_bytes(np.arange(20).reshape(10, 2) ** 2))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] = data.draw(st.integers(0, 255))
    try:
        assert bytes_to_differences(bytes(content)).size <= 1 << 22
    except ValueError:
        return


@given(st.binary(max_size=60))
def test_maps_are_read_or_refused(content):
    try:
        assert isinstance(bytes_to_map(content), dict)
    except ValueError:
        return


def test_maps_hold_plain_values_and_arrays():
    table = {"a": 1, "b": None, "c": [1.5, "x"], "d": {"e": np.arange(3)}}
    restored = bytes_to_map(map_to_bytes(table))
    assert restored["c"] == (1.5, "x")
    assert (restored["d"]["e"] == np.arange(3)).all()
    floats = bytes_to_map(map_to_bytes({"f": np.array([[0.1, -0.0]])}))["f"]
    assert floats.tobytes() == np.array([[0.1, -0.0]]).tobytes()
    with pytest.raises(TypeError, match="set in a map"):
        map_to_bytes({"a": {1}})

"""Packets of MQTT against the standard's own examples, and against paho's."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from protocol.mqtt_packets import (
    PacketStream,
    answer_of,
    length_bytes,
    publish_packet,
)


class FilledSocket:
    """What paho takes for an open socket."""


def written_by_paho(version, topic, payload, *, number, retain, properties):
    """The packet that paho makes of the same message."""
    client = Client(CallbackAPIVersion.VERSION2, protocol=version)
    client._sock = FilledSocket()
    client._on_socket_register_write = lambda *_: None
    qos = 0 if number is None else 1
    client._send_publish(
        number, topic.encode(), payload, qos, retain, False, None, properties
    )
    client._sock = None  # it would close it
    return bytes(client._out_packet[0]["packet"])


@pytest.mark.parametrize(
    ("length", "expected"),
    [
        (0, "00"),
        (127, "7f"),
        (128, "8001"),
        (16_383, "ff7f"),
        (16_384, "808001"),
        (2_097_151, "ffff7f"),
        (268_435_455, "ffffff7f"),
    ],
)
def test_lengths_are_those_of_the_standards_table(length, expected):
    assert length_bytes(length).hex() == expected


def test_a_packet_by_hand():
    assert publish_packet("a/b", b"xy", number=10) == bytes.fromhex(
        "32 09  00 03 61 2f 62  00 0a  78 79"
    )
    assert publish_packet("a/b", b"", retain=True) == bytes.fromhex(
        "31 05  00 03 61 2f 62"
    )


@settings(max_examples=30)
@given(
    topic=st.text(st.characters(codec="utf-8", exclude_characters="+#\0"), min_size=1),
    payload=st.binary(max_size=300),
    number=st.none() | st.integers(1, 65_535),
    retain=st.booleans(),
    content=st.none() | st.sampled_from(["application/msgpack", "application/json"]),
)
def test_packets_are_those_of_paho(topic, payload, number, retain, content):
    of_message = {"number": number, "retain": retain}
    assert publish_packet(topic, payload, **of_message) == written_by_paho(
        MQTTProtocolVersion.MQTTv311, topic, payload, **of_message, properties=None
    )
    properties = Properties(PacketTypes.PUBLISH)
    if content is not None:
        properties.ContentType = content
    assert publish_packet(
        topic, payload, **of_message, properties=properties.pack()
    ) == written_by_paho(
        MQTTProtocolVersion.MQTTv5, topic, payload, **of_message, properties=properties
    )


@pytest.mark.parametrize("topic", ["", "a/+/b", "a/#", "a\0b", "x" * 65_536, "\ud800"])
def test_a_topic_that_nobody_can_publish_on_is_refused(topic):
    with pytest.raises(ValueError):  # noqa: PT011 - what it says differs
        publish_packet(topic, b"")


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        ("40 02 80 01", (0x8001, 0)),
        ("40 03 80 01 00", (0x8001, 0)),
        ("40 03 80 01 87", (0x8001, 0x87)),
        ("40 04 80 01 10 00", (0x8001, 0x10)),
        ("40 00", None),
        ("40 01 80", None),
        ("90 03 80 01 00", None),
        ("d0 00", None),
    ],
)
def test_answers_are_read(packet, expected):
    assert answer_of(bytes.fromhex(packet)) == expected


PACKETS = [
    bytes.fromhex("20 03 00 00 00"),
    bytes.fromhex("d0 00"),
    publish_packet("a", bytes(200), number=3),
    bytes.fromhex("40 02 80 01"),
]


@given(st.lists(st.integers(0, sum(map(len, PACKETS)))))
def test_packets_are_the_same_however_they_are_cut(cuts):
    stream, data = PacketStream(), b"".join(PACKETS)
    edges = [0, *sorted(cuts), len(data)]
    parts = itertools.pairwise(edges)
    found = [one for begin, end in parts for one in stream.feed(data[begin:end])]
    assert (found, stream.begun) == (PACKETS, b"")


def test_the_beginning_of_a_packet_waits():
    stream = PacketStream()
    assert stream.feed(PACKETS[2][:50]) == []
    assert stream.begun == PACKETS[2][:50]


def test_what_has_no_length_comes_as_it_is():
    stream, data = PacketStream(), b"\x20\xff\xff\xff\xff\x01 no MQTT"
    assert stream.feed(PACKETS[1] + data) == [PACKETS[1], data]


@given(st.lists(st.binary(max_size=50), max_size=20))
def test_nothing_is_lost_of_any_bytes(chunks):
    stream, found = PacketStream(), b""
    for chunk in chunks:
        found += b"".join(stream.feed(chunk))
    assert found + stream.begun == b"".join(chunks)

"""Packets of MQTT by hand, from the tables of the OASIS standard."""

import contextlib
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.broker.decoder import HEAD_BYTES, PacketDecoder, PacketError
from traverse.broker.packets import (
    Acknowledged,
    Connected,
    Disconnected,
    Message,
    Pong,
    Property,
    Version,
    acknowledgement_packet,
    connect_packet,
    packed_properties,
    publish_packet,
    subscribe_packet,
    unsubscribe_packet,
)

V311, V5 = Version.V311, Version.V5


def test_connect_by_hand():
    plain = b"\x10\x0d\x00\x04MQTT\x04\x02\x00\x0a\x00\x01a"
    assert connect_packet("a", V311, 10) == plain
    with_all = connect_packet(
        "a",
        V5,
        10,
        clean_start=False,
        username="u",
        password="p",
        will=Message("w", b"gone", qos=1, retain=True),
        properties={Property.RECEIVE_MAXIMUM: 32, Property.SESSION_EXPIRY_S: 3600},
    )
    # Flags: user, password, will retained and of QoS 1, no clean start.
    head = b"\x00\x04MQTT\x05\xec\x00\x0a" + b"\x08\x21\x00\x20\x11\x00\x00\x0e\x10"
    payload = b"\x00\x01a" + b"\x00" + b"\x00\x01w\x00\x04gone" + b"\x00\x01u\x00\x01p"
    assert with_all == bytes((0x10, len(head + payload))) + head + payload


def test_publish_by_hand():
    assert publish_packet("live", b"abc", properties=b"\0") == (
        b"\x30\x0a\x00\x04live\x00abc"
    )
    packet = publish_packet("p", b"abc", qos=1, number=258, properties=b"\0")
    assert packet == b"\x32\x09\x00\x01p\x01\x02\x00abc"
    assert publish_packet("p", b"abc", qos=1, number=258) == (
        b"\x32\x08\x00\x01p\x01\x02abc"
    )
    kept = publish_packet(
        "s", bytes(123), qos=1, retain=True, number=1, properties=b"\0"
    )
    assert kept[:3] == b"\x33\x81\x01"  # 129 bytes
    long = publish_packet("s", bytes(20_000))
    assert long[:4] == b"\x30\xa3\x9c\x01"  # 0x23 + 0x1c * 128 + 16384 = 20 003


def test_the_others_by_hand():
    assert acknowledgement_packet(258) == b"\x40\x02\x01\x02"
    filters = [("a/+", 1), ("b", 0)]
    assert subscribe_packet(filters, 1, V311) == (
        b"\x82\x0c\x00\x01\x00\x03a/+\x01\x00\x01b\x00"
    )
    assert subscribe_packet(filters, 1, V5) == (
        b"\x82\x0d\x00\x01\x00\x00\x03a/+\x01\x00\x01b\x00"
    )
    assert unsubscribe_packet(["b"], 2, V5) == b"\xa2\x06\x00\x02\x00\x00\x01b"
    answer = {Property.CONTENT_TYPE: "application/json", Property.CORRELATION: b"\1\2"}
    assert packed_properties(answer) == (
        b"\x18\x03\x00\x10application/json\x09\x00\x02\x01\x02"
    )


@pytest.mark.parametrize("topic", ["", "a/#", "a/+/b", "a" * 65_536, "\ud800", "a\0b"])
def test_topics_that_nothing_can_be_published_on_are_refused(topic):
    with pytest.raises(ValueError, match=r"topic|surrogates"):
        publish_packet(topic, b"")


FROM_A_BROKER = {
    b"\x20\x03\x00\x00\x00": Connected(0, False, {}),
    b"\x20\x0b\x01\x9a\x08\x27\x00\x00\x08\x00\x21\x00\x10": Connected(
        0x9A, True, {Property.MAXIMUM_PACKET_BYTES: 2048, Property.RECEIVE_MAXIMUM: 16}
    ),
    b"\x20\x02\x00\x01": Connected(1, False, {}),  # of MQTT 3.1.1, to an offer of 5
    b"\x30\x0a\x00\x04live\x00abc": Message("live", b"abc", n_bytes=3),
    b"\x33\x12\x00\x01p\x01\x02\x08\x08\x00\x01r\x09\x00\x01\x07xyz!": Message(
        "p",
        b"xyz!",
        1,
        True,
        258,
        {Property.RESPONSE_TOPIC: "r", Property.CORRELATION: b"\x07"},
        4,
    ),
    b"\x30\x0b\x00\x01p\x07\x26\x00\x01k\x00\x01v": Message("p", b""),  # for users
    b"\x30\x07\x00\x01p\x03\x0b\x80\x01": Message(
        "p",
        b"",
        properties={0x0B: 128},  # a subscription identifier
    ),
    b"\x40\x02\x00\x01": Acknowledged(1, (0,)),
    b"\x40\x03\x00\x02\x10": Acknowledged(2, (0x10,)),  # no matching subscribers
    b"\x40\x09\x00\x04\x97\x05\x1f\x00\x02no": Acknowledged(4, (0x97,)),
    b"\x90\x05\x00\x05\x00\x01\x87": Acknowledged(5, (1, 0x87)),
    b"\xb0\x04\x00\x06\x00\x00": Acknowledged(6, (0,)),
    b"\xd0\x00": Pong(),
    b"\xe0\x00": Disconnected(0, {}),
    b"\xe0\x01\x8b": Disconnected(0x8B, {}),
    b"\xe0\x07\x95\x05\x1f\x00\x02no": Disconnected(
        0x95, {Property.REASON_STRING: "no"}
    ),
}


def decoded(data, cuts=(), version=V5, max_payload_bytes=1000):
    decoder, packets = PacketDecoder(version, max_payload_bytes), []
    for begin, end in pairwise([0, *sorted(cuts), len(data)]):
        decoder.feed(data[begin:end])
        packets += decoder.packets()
    return packets


@given(
    order=st.lists(st.sampled_from(list(FROM_A_BROKER)), max_size=12),
    cuts=st.lists(st.integers(0, 150), max_size=8),
)
def test_packets_are_read_however_they_arrive(order, cuts):
    data = b"".join(order)
    cuts = [cut for cut in cuts if cut <= len(data)]
    assert decoded(data, cuts) == [FROM_A_BROKER[packet] for packet in order]


def test_packets_of_mqtt_3_have_no_properties():
    data = b"\x90\x03\x00\x05\x80\x32\x08\x00\x01p\x01\x02abc"
    assert decoded(data, version=V311) == [
        Acknowledged(5, (0x80,)),
        Message("p", b"abc", 1, number=258, n_bytes=3),
    ]


@pytest.mark.parametrize("step", [1_000, 65_536, 10**7])
def test_of_a_message_that_is_too_long_the_beginning_is_kept(step):
    n = 3_000_000
    long = publish_packet(
        "p", bytes(range(256)) * (n // 256), qos=1, number=7, properties=b"\0"
    )
    data = long + b"\x40\x02\x00\x01" + long + b"\xd0\x00"
    first, second, third, fourth = decoded(data, range(0, len(data), step))
    n_bytes = n // 256 * 256
    cut = Message("p", (bytes(range(256)) * 4)[:1000], 1, number=7, n_bytes=n_bytes)
    assert (first, third) == (cut, cut)
    assert (second, fourth) == (Acknowledged(1, (0,)), Pong())


def test_properties_that_are_too_long_cost_the_message_its_use_only():
    user = b"\x26\x00\x01k\xff\xff" + bytes(65_535)
    properties = user * (HEAD_BYTES // len(user) + 2)
    length = len(properties)
    packed = bytes((length & 0x7F | 0x80, length >> 7 & 0x7F | 0x80, length >> 14))
    data = publish_packet("p", b"abc", qos=1, number=7, properties=packed + properties)
    message, pong = decoded(data + b"\xd0\x00")
    assert (message.topic, message.payload, message.number) == ("p", b"", 7)
    assert message.n_bytes > 1000
    assert pong == Pong()


def test_of_thousands_of_properties_the_first_are_read():
    expiry, user = b"\x02\x00\x00\x00\x09", b"\x26\x00\x00\x00\x00"
    properties = expiry + user * 30_000 + expiry
    length = len(properties)
    packed = bytes((length & 0x7F | 0x80, length >> 7 & 0x7F | 0x80, length >> 14))
    message, pong = decoded(
        publish_packet("p", b"abc", properties=packed + properties) + b"\xd0\x00"
    )
    assert message == Message("p", b"abc", properties={2: 9}, n_bytes=3)
    assert pong == Pong()


@pytest.mark.parametrize(
    "data",
    [
        b"\x10\x00",  # CONNECT is a client's
        b"\x00\x00",
        b"\x20\x01\x00",
        b"\x34\x05\x00\x01p\x00\x01",  # quality of service 2
        b"\x30\x03\x00\x05p",
        b"\x30\x03\x00\x01\xff",  # no UTF-8
        b"\x30\x06\x00\x00\x03\x23\x00\x01",  # a topic alias, which was not offered
        b"\x30\x05\x00\x01p\x01\x77",  # there is no such property
        b"\x30\x05\x00\x01p\x09\x00",  # properties longer than the packet
        b"\x40\x01\x00",
        b"\xe0\x80\x80\x80\x80\x01",  # a length of five bytes
    ],
)
def test_what_no_broker_sends_is_refused(data):
    with pytest.raises(PacketError):
        decoded(data)


@given(st.binary(max_size=60))
def test_rubbish_is_a_packet_an_error_or_incomplete(data):
    with contextlib.suppress(PacketError):
        decoded(data)

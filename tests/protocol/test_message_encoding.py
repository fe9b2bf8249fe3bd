import json
import math

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.message_examples import EVENT, EXAMPLES, HEALTH, POINT
from tests.protocol.message_strategies import messages
from traverse.protocol.arrays import array_to_bytes
from traverse.protocol.encoding import (
    MAX_DEPTH,
    MAX_ELEMENTS,
    MessageError,
    content_type,
    decode,
    encode,
    parse_args,
)
from traverse.protocol.messages import (
    MESSAGES,
    Command,
    Event,
    Health,
    Message,
    Point,
)
from traverse.protocol.messages.plain import MAX_LEVELS

COMMAND = Command(request="r", args={})


def packed(**changes: object) -> bytes:
    return msgpack.packb(COMMAND.model_dump() | changes)


def nested(levels: int, encoding: str) -> bytes:
    """A command that has so many maps and arrays inside each other, itself counted."""
    inner: object = 1
    for _ in range(levels - 2):
        inner = [inner]
    values = COMMAND.model_dump() | {"args": {"a": inner}}
    return json.dumps(values).encode() if encoding == "json" else msgpack.packb(values)


JSON_HEAD = b'{"schema": "traverse/command/1", "request": "r", "args": '

MALFORMED = {
    "nothing": (b"", "command"),
    "truncated MessagePack": (packed()[:-1], "incomplete input"),
    "trailing MessagePack": (packed() + b"\xc0", "extra data"),
    "reserved byte of MessagePack": (b"\x81\xa1a\xc1", "one whole MessagePack map"),
    "MessagePack that is no map": (b"\x93\x01\x02\x03", "a map of keys to values"),
    "MessagePack number": (b"\x07", "a map of keys to values"),
    "key twice in MessagePack": (b"\x82\xa1a\x01\xa1a\x02", "a key given twice"),
    "number as key": (b"\x81\x01\x02", "MessagePack map"),
    "bytes as key": (b"\x81\xc4\x01a\x02", "keys that are texts"),
    "array as key": (b"\x81\x91\x01\x02", "MessagePack map"),
    "text that is no UTF-8": (b"\x81\xa2\xff\xfe\x01", "utf-8"),
    "unknown extension": (packed(args=msgpack.ExtType(5, b"x")), "extension type 5"),
    "timestamp extension": (packed(args=msgpack.Timestamp(1)), "command.args"),
    "torn timestamp": (b"\x81\xa1a\xd4\xff\x00", "MessagePack map"),
    "torn array": (packed(args=msgpack.ExtType(1, b"f\x08")), "a head of at least 3"),
    "array where none belongs": (
        packed(args=msgpack.ExtType(1, array_to_bytes(np.zeros(2)))),
        "command.args",
    ),
    "bytes for a text": (packed(request=b"r"), "command.request"),
    "number for a text": (packed(request=7), "command.request: 7"),
    "empty request": (packed(request=""), "command.request"),
    "request of 65 characters": (packed(request="r" * 65), "at most 64 characters"),
    "NaN in MessagePack": (packed(args={"a": math.nan}), "finite"),
    "integer of 54 bits": (packed(args={"a": 2**53}), "9007199254740991"),
    "nested too deeply": (nested(MAX_DEPTH + 1, "msgpack"), "deeper nesting"),
    "nested absurdly": (b"\x91" * 100_000, "MessagePack map"),
    "huge announced array": (b"\xdd\xff\xff\xff\xff", "exceeds max_array_len"),
    "announced arrays in arrays": (b"\xdd\x00\x00\x0f\xff" * 9999, "MessagePack map"),
    "huge announced map": (b"\xdf\xff\xff\xff\xff", "exceeds max_map_len"),
    "long array": (packed(args={"a": [0] * (MAX_ELEMENTS + 1)}), "max_array_len"),
    "other schema": (
        packed(schema="traverse/point/1"),
        "expected 'traverse/command/1'",
    ),
    "later schema": (packed(schema="traverse/command/2"), "traverse/command/2"),
    "schema that is no text": (packed(schema=[1]), "command.schema"),
    "no schema": (b"\x80", "command.schema: None"),
    "unknown key": (packed(more=1), "command.more: a key that this message"),
    "truncated JSON": (JSON_HEAD, "one JSON object"),
    "trailing JSON": (JSON_HEAD + b"{}} x", "Extra data"),
    "JSON that is no map": (b"[1]", "MessagePack map"),
    "key twice in JSON": (JSON_HEAD + b'{}, "args": {}}', "a key given twice"),
    "NaN in JSON": (JSON_HEAD + b'{"a": NaN}}', "NaN; expected finite"),
    "infinity in JSON": (JSON_HEAD + b'{"a": -Infinity}}', "-Infinity"),
    "infinity as a number of JSON": (JSON_HEAD + b'{"a": 1e999}}', "finite"),
    "integer of 5000 digits": (JSON_HEAD + b'{"a": ' + b"9" * 5000 + b"}}", "digits"),
    "integer of 20 digits": (JSON_HEAD + b'{"a": ' + b"9" * 20 + b"}}", "90071992547"),
    "JSON that is no UTF-8": (JSON_HEAD + b'"\xff"}', "utf-8"),
    "JSON with half a character": (JSON_HEAD + b'{"a": "\\ud800"}}', "command"),
    "half a character as a key": (JSON_HEAD + b'{"\\ud800": 1}}', "command"),
    "JSON nested too deeply": (nested(MAX_DEPTH + 1, "json"), "deeper nesting"),
    "JSON nested absurdly": (b"{" + b"[" * 100_000, "deeper nesting"),
    "JSON of escaped quotes": (b'{"' + b'\\"' * 500_000, "JSON object"),
    "JSON text with brackets": (b'{"' + b"[" * 1000, "Unterminated"),
}


@given(messages)
def test_messagepack_is_restored_equal(message):
    payload = encode(message, "msgpack")
    assert decode(type(message), payload) == message
    assert encode(decode(type(message), payload, "msgpack"), "msgpack") == payload


@given(messages)
def test_json_is_restored_equal(message):
    payload = encode(message, "json")
    assert decode(type(message), payload) == message
    assert encode(decode(type(message), payload, "json"), "json") == payload


@given(messages)
def test_json_is_strict_for_every_reader(message):
    json.loads(encode(message, "json"), parse_constant=pytest.fail)


@pytest.mark.parametrize("kind", MALFORMED)
def test_malformed_payload_is_refused_with_what_was_expected(kind):
    payload, phrase = MALFORMED[kind]
    with pytest.raises(MessageError) as refusal:
        decode(Command, payload)
    assert phrase.lower() in str(refusal.value).lower()
    assert len(str(refusal.value)) < 4000
    assert all(
        problem.where and problem.what and problem.expected
        for problem in refusal.value.problems
    )


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_the_deepest_allowed_nesting_is_read(encoding):
    assert decode(Command, nested(MAX_LEVELS + 1, encoding)).args["a"]
    with pytest.raises(MessageError, match=f"at most {MAX_LEVELS} levels"):
        decode(Command, nested(MAX_LEVELS + 2, encoding))


def test_a_payload_that_is_too_long_is_refused_unread():
    payload = encode(EVENT, "json")
    assert decode(Event, payload, max_bytes=len(payload)) == EVENT
    with pytest.raises(MessageError, match=f"expected at most {len(payload) - 1}"):
        decode(Event, payload, max_bytes=len(payload) - 1)
    with pytest.raises(MessageError, match="bytes; expected at most"):
        decode(Event, bytes(2_000_000))


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_the_other_encoding_is_refused_when_one_is_demanded(encoding):
    other = {"msgpack": "json", "json": "msgpack"}[encoding]
    with pytest.raises(MessageError):
        decode(Event, encode(EVENT, other), encoding)


def test_a_hundred_thousand_mistakes_are_reported_as_few():
    infinities = b",".join([b"1e999"] * 100_000)
    with pytest.raises(MessageError) as refusal:
        decode(Command, JSON_HEAD + b'{"a": [' + infinities + b"]}}")
    assert len(refusal.value.problems) == 1
    keys = b",".join(b'"%d": 1' % i for i in range(50_000))
    with pytest.raises(MessageError) as refusal:
        decode(Command, JSON_HEAD + b"{}, " + keys + b"}")
    assert len(refusal.value.problems) == 20


def test_a_long_list_of_bad_devices_ends_at_the_first():
    values = json.loads(encode(HEALTH, "json")) | {"devices": [{}] * 100_000}
    with pytest.raises(MessageError) as refusal:
        decode(Health, json.dumps(values).encode())
    places = {problem.where.rsplit(".", 1)[0] for problem in refusal.value.problems}
    assert places == {"health.devices.0"}


def test_white_space_before_json_is_recognised():
    assert decode(Event, b" \r\n\t" + encode(EVENT, "json")) == EVENT


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_every_prefix_is_refused(name, encoding):
    payload = encode(EXAMPLES[name], encoding)
    for length in range(len(payload)):
        with pytest.raises(MessageError):
            decode(type(EXAMPLES[name]), payload[:length])


@given(st.sampled_from(MESSAGES), st.binary(max_size=200))
def test_arbitrary_bytes_give_a_message_error(message_type, payload):
    with pytest.raises(MessageError):
        decode(message_type, payload)


@given(
    st.sampled_from(sorted(EXAMPLES)),
    st.sampled_from(["msgpack", "json"]),
    st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=3),
)
def test_changed_bytes_give_a_message_or_a_message_error(name, encoding, changes):
    payload = bytearray(encode(EXAMPLES[name], encoding))
    for place, byte in changes:
        payload[round(place * (len(payload) - 1))] = byte
    try:
        message = decode(type(EXAMPLES[name]), bytes(payload))
    except MessageError:
        return
    assert decode(type(message), encode(message, encoding), encoding) == message


def test_all_mistakes_are_told_at_once_with_their_places():
    values = POINT.model_dump() | {
        "seq": -1,
        "xyz_mm": (1.0, math.inf, 3.0),
        "trigger": "foot",
        "quality": {"ok": True},
    }
    with pytest.raises(MessageError) as refusal:
        decode(Point, msgpack.packb(values))
    assert [problem.where for problem in refusal.value.problems] == [
        "point.seq",
        "point.trigger",
        "point.xyz_mm.1",
        "point.quality.flags",
    ]


@pytest.mark.parametrize(
    "text", ['"+5"', '"5.0"', '" 5"', '"٣"', "5", '"' + "9" * 19 + '"']
)
def test_a_time_in_json_is_a_string_of_digits(text):
    payload = encode(EVENT, "json").decode()
    payload = payload.replace('"1795251247123456789"', text)
    with pytest.raises(MessageError, match="first_ns"):
        decode(Event, payload.encode())


def test_a_time_in_messagepack_is_an_integer():
    values = EVENT.model_dump() | {"first_ns": "1795251247123456789"}
    with pytest.raises(MessageError, match="first_ns"):
        decode(Event, msgpack.packb(values))


def test_integers_are_good_floats_but_not_the_reverse():
    written = json.loads(encode(POINT, "json"))
    with_integers = json.dumps(written | {"xyz_mm": [1, 2, 3]}).encode()
    assert decode(Point, with_integers).xyz_mm == (1.0, 2.0, 3.0)
    with pytest.raises(MessageError, match=r"point\.samples: 25\.0"):
        decode(Point, json.dumps(written | {"samples": 25.0}).encode())


def test_content_types_are_those_of_the_contract():
    assert content_type("msgpack") == "application/msgpack"
    assert content_type("json") == "application/json"


def test_unknown_command_is_refused_with_the_known_ones():
    with pytest.raises(MessageError, match="'format'; expected one of point, scan"):
        parse_args("format", {})


@given(st.sampled_from(MESSAGES))
def test_no_message_is_taken_for_another(message_type: type[Message]):
    for example in EXAMPLES.values():
        if type(example) is not message_type:
            with pytest.raises(MessageError, match="schema"):
                decode(message_type, encode(example, "msgpack"))

"""Messages against payloads that were written without our encoder, or kept."""

import json

import pytest

from tests.protocol.message_examples import (
    ARGS,
    EVENT,
    EXAMPLES,
    GOLDEN,
    POINT,
    json_text,
)
from traverse.protocol.encoding import decode, encode, parse_args
from traverse.protocol.messages import COMMANDS, MESSAGES, Event, Point

# MessagePack: 8n map of n pairs, An text of n bytes (to BF: 31), 9n array of n,
# C0 nil, C2 false, C3 true, CF uint 64, CB float 64, 00 to 7F themselves.
EVENT_BYTES = """
8D                                                           13 pairs
A6 73 63 68 65 6D 61                                         schema
   B0 74 72 61 76 65 72 73 65 2F 65 76 65 6E 74 2F 31        traverse/event/1
A3 61 72 6D                                                  arm
   A7 62 65 6E 63 68 2D 37                                   bench-7
A7 73 65 73 73 69 6F 6E                                      session
   C0                                                        nil
A8 73 65 76 65 72 69 74 79                                   severity
   A5 65 72 72 6F 72                                         error
A4 63 6F 64 65                                               code
   AB 64 65 76 69 63 65 2E 6C 6F 73 74                       device.lost
A4 74 65 78 74                                               text
   B5 62 61 73 65 3A 20 74 68 65 20 70 6F 72 74 20
      63 6C 6F 73 65 64                                      base: the port closed
A6 72 65 6D 65 64 79                                         remedy
   B0 43 68 65 63 6B 20 74 68 65 20 63 61 62 6C 65 2E        Check the cable.
A6 73 6F 75 72 63 65                                         source
   A4 62 61 73 65                                            base
A6 61 63 74 69 76 65                                         active
   C3                                                        true
A8 66 69 72 73 74 5F 6E 73                                   first_ns
   CF 18 EA 03 7F 63 5E E3 15                                1795251247123456789
A7 6C 61 73 74 5F 6E 73                                      last_ns
   CF 18 EA 03 7F 63 5E E3 16                                1795251247123456790
A5 63 6F 75 6E 74                                            count
   02                                                        2
A4 64 61 74 61                                               data
   81                                                        1 pair
   A9 73 69 6C 65 6E 63 65 5F 73                             silence_s
      CB 3F E0 00 00 00 00 00 00                             0.5
"""


def bytes_of_listing(listing: str) -> bytes:
    """The hex columns of a listing; their meaning is from column 61 on."""
    return bytes.fromhex("".join(line[:60] for line in listing.splitlines()))


def golden_bytes(name: str) -> bytes:
    return bytes.fromhex((GOLDEN / f"{name}.msgpack.hex").read_text())


def test_event_is_what_the_messagepack_specification_says():
    assert encode(EVENT, "msgpack") == bytes_of_listing(EVENT_BYTES)
    assert decode(Event, bytes_of_listing(EVENT_BYTES)) == EVENT


@pytest.mark.parametrize("name", EXAMPLES)
def test_messagepack_is_byte_for_byte_the_golden_one(name):
    example = EXAMPLES[name]
    assert encode(example, "msgpack") == golden_bytes(name)
    assert decode(type(example), golden_bytes(name)) == example


@pytest.mark.parametrize("name", EXAMPLES)
def test_json_has_the_golden_keys_and_values_in_order(name):
    example = EXAMPLES[name]
    golden = (GOLDEN / f"{name}.json").read_text()
    assert json_text(example) == golden
    assert decode(type(example), golden.encode()) == example


def test_no_golden_file_is_left_over():
    expected = {f"{name}.{end}" for name in EXAMPLES for end in ("json", "msgpack.hex")}
    assert {path.name for path in GOLDEN.iterdir()} == expected


def test_every_message_and_command_has_an_example():
    assert {type(example) for example in EXAMPLES.values()} == set(MESSAGES)
    assert [args.command for args in ARGS] == list(COMMANDS)
    names = (
        "point scan undo label probe reference home reload align session resend record "
    )
    assert " ".join(COMMANDS) == names + "covariance"


@pytest.mark.parametrize("args", ARGS, ids=lambda args: args.command)
@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_arguments_survive_the_envelope(args, encoding):
    name = f"command-{args.command}"
    envelope = decode(type(EXAMPLES[name]), encode(EXAMPLES[name], encoding), encoding)
    assert envelope.request == "r-1"
    assert parse_args(args.command, envelope.args) == args


def test_point_without_a_nullable_key_is_refused_too():
    values = json.loads(encode(POINT, "json"))
    del values["retracts"]
    with pytest.raises(ValueError, match=r"point\.retracts: nothing; expected a value"):
        decode(Point, json.dumps(values).encode())

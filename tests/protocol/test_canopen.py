"""Frames of CANopen: bytes by hand from CiA 301 and 406, and noise."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen import objects
from traverse.protocol.canopen.errors import BusCondition, decode_error

GOLDEN = [
    (0x705, "00", wire.Heartbeat(5, wire.BOOT_UP)),
    (0x705, "05", wire.Heartbeat(5, wire.STATE_OPERATIONAL)),
    (0x705, "7F", wire.Heartbeat(5, wire.STATE_PRE_OPERATIONAL)),
    (0x705, "85", wire.Heartbeat(5, wire.STATE_OPERATIONAL)),  # guarding's toggle bit
    (0x080, "", wire.Sync(None)),
    (0x080, "03", wire.Sync(3)),
    (0x185, "40 E2 01 00", wire.Position(5, 123456)),
    (0x1FF, "FF FF FF FF", wire.Position(127, 2**32 - 1)),
    (0x185, "40 E2 01 00 00 00 12 34", wire.Position(5, 123456)),
    (
        0x085,
        "00 10 01 01 00 00 00 00",
        wire.Emergency(5, 0x1000, 1, bytes.fromhex("01 00 00 00 00")),
    ),
    (0x085, "00 00 00 00 00 00 00 00", wire.Emergency(5, 0, 0, bytes(5))),
    (
        0x585,
        "43 00 10 00 96 01 02 00",
        wire.SdoAnswer(5, bytes.fromhex("43 00 10 00 96 01 02 00")),
    ),
]

NOTHING = [
    (0x000, "01 05"),  # NMT is the master's
    (0x605, "40 00 10 00 00 00 00 00"),  # so are questions
    (0x080, "00 01"),
    (0x085, "00 10 01"),
    (0x185, "40 E2 01"),
    (0x285, "40 E2 01 00"),
    (0x585, "43 00"),
    (0x705, ""),
    (0x180, "40 E2 01 00"),  # there is no node 0
    (0x7E4, "44 00 00 00 00 00 00 00"),
]


@pytest.mark.parametrize(("can_id", "data", "expected"), GOLDEN)
def test_frames_are_read_as_the_profiles_say(
    can_id: int, data: str, expected: wire.Message
) -> None:
    assert wire.decode(can_id, bytes.fromhex(data)) == expected
    assert wire.decode(can_id, bytearray.fromhex(data)) == expected


@pytest.mark.parametrize(("can_id", "data"), NOTHING)
def test_other_frames_are_nothing(can_id: int, data: str) -> None:
    assert wire.decode(can_id, bytes.fromhex(data)) is None


@pytest.mark.parametrize(("can_id", "data", "_expected"), GOLDEN)
def test_a_shortened_frame_is_never_taken_for_a_whole_one(
    can_id: int, data: str, _expected: wire.Message
) -> None:
    content = bytes.fromhex(data)
    needed = {0x080: 0, 0x185: 4, 0x1FF: 4}.get(can_id, len(content))
    for n in range(needed):
        assert wire.decode(can_id, content[:n]) is None


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_any_frame_is_a_value_of_its_node_or_nothing(can_id: int, data: bytes) -> None:
    message = wire.decode(can_id, data)
    if message is None or isinstance(message, wire.Sync):
        return
    assert message.node == can_id & 0x7F
    assert 1 <= message.node <= 127
    services = {
        wire.Position: 0x180,
        wire.Emergency: 0x080,
        wire.Heartbeat: 0x700,
        wire.SdoAnswer: 0x580,
    }
    assert services[type(message)] == can_id & 0x780
    if isinstance(message, wire.Position):
        assert list(data[:4]) == [message.count >> 8 * k & 0xFF for k in range(4)]


@given(st.integers(0, 0x1FFF_FFFF), st.binary(max_size=8))
def test_any_error_frame_is_a_condition(can_id: int, data: bytes) -> None:
    assert isinstance(decode_error(can_id, data), BusCondition)


def test_error_frames_of_socketcan() -> None:
    # Classes and states of linux/can/error.h.
    assert decode_error(0x2000_0040, bytes(8)) == BusCondition(bus_off=True)
    assert decode_error(0x100, bytes(8)) == BusCondition(restarted=True)
    passive = bytes.fromhex("00 30 00 00 00 00 00 00")
    assert decode_error(0x04, passive) == BusCondition(passive=True)
    assert decode_error(0x04, b"\0\x40") == BusCondition(active=True)
    assert decode_error(0x04, b"\0\x01") == BusCondition(overflow=True)
    # No acknowledgement, and a broken frame, are no condition of the controller.
    assert decode_error(0x20, bytes(8)) == decode_error(0x80, passive) == BusCondition()


def test_commands_and_identifiers() -> None:
    assert wire.nmt_command(wire.START, 5).hex() == "0105"
    assert wire.nmt_command(wire.PRE_OPERATIONAL, 0).hex() == "8000"
    assert wire.identifiers([5]) == [0x080, 0x085, 0x185, 0x585, 0x705]


def test_seven_nodes_fill_a_bus_as_counted_by_hand() -> None:
    # 47, 79, 95, 111 bits without stuffing; one bit more for each four that are
    # stuffed after the first: (34 + 8 n - 1) // 4.
    assert [wire.frame_bits(n) for n in (0, 4, 6, 8)] == [55, 95, 115, 135]
    assert wire.largest_sync_rate_hz(7, 1_000_000) == pytest.approx(1e6 / 720)


def test_bits_and_codes_in_words() -> None:
    assert objects.alarm_text(0x0001) == "position error"
    assert objects.alarm_text(0x1002) == "commissioning diagnostic, bit 12"
    assert objects.alarm_text(0) == "none"
    assert objects.warning_text(0x14) == "watchdog of its processor, battery low"
    assert objects.emergency_text(0x1000) == "generic error"
    assert objects.emergency_text(0x4210) == "temperature"
    assert objects.emergency_text(0x8130) == "heartbeat or guarding missed"
    assert objects.emergency_text(0xFF01) == "of the maker's own"
    assert objects.emergency_text(0x0100) == "an error of no known kind"

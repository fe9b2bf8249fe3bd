import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol import amt21

addresses = st.integers(1, 63).map(lambda number: 4 * number)
values = st.integers(0, 0x3FFF)


def word_by_definition(value: int) -> bytes:
    """K1 = NOT XOR of the odd bits, K0 = NOT XOR of the even bits, as in the text."""
    odd = even = 0
    for bit in range(0, 14, 2):
        even ^= value >> bit & 1
        odd ^= value >> (bit + 1) & 1
    word = (1 - odd) << 15 | (1 - even) << 14 | value
    return bytes((word & 0xFF, word >> 8))


def read(request: bytes, data: bytes, *, echoed: bool = False) -> int | None:
    reply = amt21.Reply(request, echoed=echoed)
    reply.feed(data)
    return reply.value


@pytest.mark.parametrize(
    ("request_hex", "reply_hex", "value"),
    [
        ("54", "AB 61", 0x21AB),  # the makers' own example: 8619
        ("54", "00 C0", 0),
        ("54", "FF 3F", 0x3FFF),
        ("54", "34 92", 0x1234),
    ],
)
def test_positions_as_they_stand_on_the_wire(request_hex, reply_hex, value):
    assert amt21.position_request(0x54) == bytes.fromhex(request_hex)
    assert read(b"\x54", bytes.fromhex(reply_hex)) == value


@pytest.mark.parametrize(("reply_hex", "turns"), [("FF 3F", -1), ("03 00", 3)])
def test_turns_as_they_stand_on_the_wire(reply_hex, turns):
    request = amt21.turns_request(0x54)
    assert request == b"\x55"
    value = read(request, bytes.fromhex(reply_hex))
    assert value is not None
    assert amt21.turns_of(value) == turns


def test_the_extended_commands():
    assert amt21.zero_request(0x54) == bytes.fromhex("56 5E")
    assert amt21.reset_request(0x54) == bytes.fromhex("56 75")


@pytest.mark.parametrize("number", [-4, 0, 1, 2, 0x55, 0xFD, 0x100])
def test_what_is_no_address_is_refused(number):
    assert not amt21.is_address(number)
    with pytest.raises(ValueError, match="multiple of 4"):
        amt21.position_request(number)


@given(values)
def test_check_bits_are_those_of_the_definition(value):
    assert read(b"\x54", word_by_definition(value)) == value


def test_a_quarter_of_all_words_is_sound_and_no_single_error_passes():
    sound = [word for word in range(1 << 16) if amt21.is_sound(word)]
    assert len(sound) == 1 << 14
    assert not any(amt21.is_sound(word ^ 1 << bit) for word in sound for bit in (0, 15))
    assert all(
        not amt21.is_sound(word ^ 1 << bit) for word in sound[::61] for bit in range(16)
    )


@given(addresses, values, st.booleans(), st.integers(0, 3))
def test_every_prefix_of_an_answer_is_incomplete(address, value, echoed, cut):
    request = amt21.position_request(address)
    answer = (request if echoed else b"") + word_by_definition(value)
    reply = amt21.Reply(request, echoed=echoed)
    is_complete = reply.feed(answer[:cut])
    assert is_complete == (cut >= len(answer))
    assert (reply.value is None) == (not is_complete)
    assert reply.feed(answer[cut:])
    assert reply.value == value
    assert reply.surplus == 0


@given(st.lists(st.binary(max_size=40), max_size=10), st.booleans())
def test_noise_gives_at_most_one_sound_value_and_never_grows(chunks, echoed):
    reply = amt21.Reply(b"\x54", echoed=echoed)
    for chunk in chunks:
        reply.feed(chunk)
    data = b"".join(chunks)
    expected = 3 if echoed else 2
    assert reply.missing == max(0, expected - len(data))
    assert reply.surplus == max(0, len(data) - expected)
    assert len(reply._heard) <= expected
    decoded = read(b"\x54", data, echoed=echoed)
    assert reply.value == decoded  # however it was cut
    if decoded is not None:
        assert data[:expected].endswith(word_by_definition(decoded))


def test_an_echo_that_is_not_the_request_spoils_the_reply():
    assert read(b"\x54", b"\x58" + word_by_definition(7), echoed=True) is None


@pytest.mark.parametrize(
    ("heard", "echoes"),
    [
        (b"", None),
        (b"\x54", True),
        (bytes.fromhex("54 AB 61"), True),
        (bytes.fromhex("AB 61"), False),
        (bytes.fromhex("54 AB 62"), None),
        (bytes.fromhex("AB 62"), None),
        (bytes.fromhex("58 AB 61"), None),
        (bytes.fromhex("AB 61 AB 61"), None),
    ],
)
def test_an_adapter_that_echoes_is_known_by_what_it_returns(heard, echoes):
    assert amt21.echo_heard(b"\x54", heard) is echoes


@given(addresses, values)
def test_no_sound_answer_is_taken_for_the_other_kind_of_adapter(address, value):
    request = amt21.position_request(address)
    answer = word_by_definition(value)
    assert amt21.echo_heard(request, answer) is False
    assert amt21.echo_heard(request, request + answer) is True

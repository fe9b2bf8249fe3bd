import struct
import sys

from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol.input_events import EVENT_BYTES, InputEvent, InputEventDecoder

shorts = st.integers(0, 0xFFFF)
events = st.tuples(
    st.integers(0, 2**31 - 1),
    st.integers(0, 999_999),
    shorts,
    shorts,
    st.integers(0, 2),
)


def bytes_of(seconds, micros, kind, code, value):
    """Field by field as the kernel's header has them on a machine with 64 bits."""
    return (
        seconds.to_bytes(8, sys.byteorder)
        + micros.to_bytes(8, sys.byteorder)
        + kind.to_bytes(2, sys.byteorder)
        + code.to_bytes(2, sys.byteorder)
        + value.to_bytes(4, sys.byteorder)
    )


def test_an_event_has_24_bytes_where_a_long_has_8():
    assert 2 * struct.calcsize("l") + 8 == EVENT_BYTES


def test_a_key_press_as_the_kernel_gives_it():
    data = bytes.fromhex(
        "39 30 00 00 00 00 00 00  15 CD 07 00 00 00 00 00  01 00 30 00 01 00 00 00"
    )
    if sys.byteorder == "little" and len(data) == EVENT_BYTES:
        (event,) = InputEventDecoder().feed(data)
        # 12345 s, 511253 us; EV_KEY, KEY_B (48), pressed
        assert event == InputEvent(12_345_511_253_000, 1, 48, 1)


@given(st.lists(events, max_size=6), st.integers(1, 60))
def test_the_cutting_into_reads_does_not_matter(written, size):
    data = b"".join(bytes_of(*fields) for fields in written)
    decoder = InputEventDecoder()
    chunks = [data[start : start + size] for start in range(0, len(data), size)]
    events = [event for chunk in chunks for event in decoder.feed(chunk)]
    assert events == [
        InputEvent(s * 10**9 + us * 1000, kind, code, value)
        for s, us, kind, code, value in written
    ]


@given(st.lists(st.binary(max_size=70), max_size=8))
def test_noise_neither_fails_nor_grows(chunks):
    decoder = InputEventDecoder()
    events = [event for chunk in chunks for event in decoder.feed(chunk)]
    assert len(events) == sum(map(len, chunks)) // EVENT_BYTES
    assert len(decoder._rest) < EVENT_BYTES

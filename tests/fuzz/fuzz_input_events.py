"""Events of the kernel's input devices: each is 24 of the received bytes."""

from tests.fuzz.chunks import chunks
from traverse.protocol.input_events import EVENT_BYTES, InputEventDecoder

PRESS = bytes.fromhex("3930000000000000 15CD070000000000 0100 3000 01000000")
SEEDS = (b"\x00" + PRESS, b"\x17" + PRESS + PRESS, b"\x04" + PRESS[:-1])


def check(data: bytes) -> None:
    """Cut or not, the same is found."""
    cut, uncut = InputEventDecoder(), InputEventDecoder()
    events = [event for chunk in chunks(data) for event in cut.feed(chunk)]
    assert list(uncut.feed(data[1:])) == events
    assert len(events) == len(data[1:]) // EVENT_BYTES

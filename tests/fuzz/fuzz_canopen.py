"""Frames of CANopen nodes: values are the bytes of the frame and nothing else."""

from traverse.protocol.canopen import frames, objects

SEEDS = tuple(
    bytes.fromhex(text)
    for text in (
        "01 85 40 E2 01 00",
        "00 80",
        "00 80 07",
        "00 85 00 10 01 01 00 00 00 00",
        "07 05 7F",
        "05 85 43 00 10 00 96 01 02 00",
    )
)


def check(data: bytes) -> None:
    """Two bytes of identifier, then the frame's data."""
    can_id, carried = int.from_bytes(data[:2]) & 0x7FF, data[2:10]
    message = frames.decode(can_id, carried)
    assert frames.decode(can_id, bytearray(carried)) == message
    if message is None or isinstance(message, frames.Sync):
        return
    assert 1 <= message.node <= 127
    assert can_id % 128 == message.node
    if isinstance(message, frames.Position):
        assert message.count == int.from_bytes(carried[:4], "little")
    if isinstance(message, frames.Emergency):
        assert message.code == int.from_bytes(carried[:2], "little")
        assert isinstance(objects.emergency_text(message.code), str)
    number = int.from_bytes(carried[:4], "little")
    assert isinstance(objects.alarm_text(number & 0xFFFF), str)
    assert isinstance(objects.warning_text(number & 0xFFFF), str)

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
    """Two bytes of identifier, then what the frame carries."""
    can_id, carried = int.from_bytes(data[:2]) & 0x7FF, data[2:10]
    found = frames.decode(can_id, carried)
    assert frames.decode(can_id, bytearray(carried)) == found
    if found is None or isinstance(found, frames.Sync):
        return
    assert 1 <= found.node <= 127
    assert can_id % 128 == found.node
    if isinstance(found, frames.Position):
        assert found.count == int.from_bytes(carried[:4], "little")
    if isinstance(found, frames.Emergency):
        assert found.code == int.from_bytes(carried[:2], "little")
        assert isinstance(objects.emergency_text(found.code), str)
    number = int.from_bytes(carried[:4], "little")
    assert isinstance(objects.alarm_text(number & 0xFFFF), str)
    assert isinstance(objects.warning_text(number & 0xFFFF), str)

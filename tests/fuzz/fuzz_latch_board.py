"""Frames of a controller board: nothing is a frame without its check sum."""

import binascii

from tests.fuzz.chunks import chunks
from tests.protocol.latch_board_frames import FROM_BOARD
from traverse.protocol.latch_board import messages as latch_board

SEEDS = tuple(b"\x05" + bytes.fromhex(frame) for frame in FROM_BOARD)
SEEDS += (b"\xff" + bytes.fromhex("".join(FROM_BOARD)),)
LONGEST_SEGMENT = 253


def sound(segment: bytes) -> bool:
    """COBS undone by its definition, and the check sum by the standard library."""
    body, offset = bytearray(), 0
    while offset < len(segment):
        following = offset + segment[offset]
        if segment[offset] == 0 or following > len(segment):
            return False
        body += segment[offset + 1 : following]
        body += b"\0" if following < len(segment) else b""
        offset = following
    check = int.from_bytes(body[-2:], "little")
    return len(body) > 2 and binascii.crc_hqx(bytes(body[:-2]), 0xFFFF) == check


def check(data: bytes) -> None:
    """Cut or not, the same is found, and no more than check sums allow."""
    cut, uncut = latch_board.Decoder(), latch_board.Decoder()
    messages = [message for chunk in chunks(data) for message in cut.feed(chunk)]
    uncut.feed(data[1:])
    assert cut.accepted == uncut.accepted
    assert cut.faults == uncut.faults
    assert cut.pending <= LONGEST_SEGMENT
    n_sound = sum(map(sound, data[1:].split(b"\0")[:-1]))
    assert cut.accepted <= n_sound
    assert len(messages) <= cut.accepted

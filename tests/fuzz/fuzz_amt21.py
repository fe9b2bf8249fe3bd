"""Replies of AMT21 encoders: at most one value, and with its check bits."""

from tests.fuzz.chunks import chunks
from traverse.protocol import amt21

SEEDS = tuple(
    bytes.fromhex(text)
    for text in ("00 00 AB 61", "01 00 54 AB 61", "00 01 FF 3F", "01 02 34 92 00")
)


def check(data: bytes) -> None:
    """The first byte decides whether the line echoes."""
    echoed = bool(data[:1] and data[0] & 1)
    request = amt21.position_request(0x54)
    reply = amt21.Reply(request, echoed=echoed)
    for chunk in chunks(data[1:]):
        reply.feed(chunk)
    heard = data[2:]
    expected = 3 if echoed else 2
    assert reply.surplus == max(0, len(heard) - expected)
    if reply.value is not None:
        word = int.from_bytes(heard[expected - 2 : expected], "little")
        assert word & 0x3FFF == reply.value
        for first in (0, 1):
            assert sum(word >> bit & 1 for bit in range(first, 16, 2)) % 2 == 1
        assert -8192 <= amt21.turns_of(reply.value) <= 8191
    assert amt21.echo_heard(request, heard) in {None, True, False}

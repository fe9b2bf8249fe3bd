"""Replies of RLS encoders: every one is in the bytes, and cuts do not matter."""

from tests.fuzz.chunks import chunks
from traverse.protocol import rls

REQUESTS = (rls.POSITION, rls.DETAILED, rls.TEMPERATURE, rls.SHORT)
SEEDS = tuple(
    bytes.fromhex(text)
    for text in (
        "04 02 31 48 8B 31 48 8F 31 48 93 31",
        "05 07 64 48 8B 00 64 48 8B 00 64 48 8B 00 64",
        "06 02 74 48 8B 01 0D",
        "17 FF 88 B8 03",
        "84 05 31 FF FE 48 8B 31 FF FE 48 8B 31 FF FE 48 8B 31",
        "00 00 76 32 31 41 30 37 78",
    )
)


def check(data: bytes) -> None:
    """The first byte chooses request and layout."""
    chosen = data[0] if data else 0
    layout = rls.Layout(10 + (chosen >> 2) % 13, turns=chosen >= 128)
    request = REQUESTS[chosen & 3]
    heard = data[2:]
    rls.serial_number(heard)
    size = layout.reply_bytes(request)
    position = rls.position(heard[:size], request, layout)
    if position is not None:
        check_values(position, layout)
    if request == rls.SHORT:
        return
    cut, uncut = rls.Replies(request, layout), rls.Replies(request, layout)
    replies = [reply for chunk in chunks(data[1:]) for reply in cut.feed(chunk)]
    assert uncut.feed(heard) == replies
    assert cut.skipped == uncut.skipped
    assert len(cut._kept) <= 2 * size
    assert len(replies) * size + cut.skipped + len(cut._kept) == len(heard)
    assert len(replies) <= heard.count(request)
    for reply in replies:
        check_values(reply, layout)


def check_values(position: rls.Position, layout: rls.Layout) -> None:
    assert 0 <= position.count < 1 << layout.bits
    assert -(1 << 15) <= position.turns < 1 << 15
    assert layout.turns or not position.turns

import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol import rls

ORBIS = rls.Layout(14)
AKSIM_17 = rls.Layout(17)
layouts = st.builds(rls.Layout, st.integers(10, 22), st.booleans())
requests = st.sampled_from([rls.POSITION, rls.SHORT, rls.DETAILED, rls.TEMPERATURE])


def written(layout, request, count, *, turns=0, flags=3, detail=0, tenths=0):
    """A reply by the words of the description, digit by digit."""
    size = 16 if layout.bits <= 14 else 24
    digits = f"{count:0{layout.bits}b}".ljust(size - 2, "0") + f"{flags:02b}"
    data = int(digits, 2).to_bytes(size // 8, "big")
    if layout.turns:
        data = (turns & 0xFFFF).to_bytes(2, "big") + data
    after = {rls.DETAILED: bytes((detail,)), rls.TEMPERATURE: b""}
    if request == rls.TEMPERATURE:
        after[request] = (tenths & 0xFFFF).to_bytes(2, "big")
    head = b"" if request == rls.SHORT else request
    return head + data + after.get(request, b"")


@pytest.mark.parametrize(
    ("request_", "reply", "layout", "expected"),
    [
        (b"1", "31 48 8B", ORBIS, rls.Position(4642, 0, False, False)),
        (b"1", "31 48 8A", ORBIS, rls.Position(4642, 0, False, True)),
        (b"1", "31 48 89", ORBIS, rls.Position(4642, 0, True, False)),
        (b"d", "64 48 8B 00", ORBIS, rls.Position(4642, 0, False, False, 0)),
        (
            b"t",
            "74 48 8B 01 0D",
            ORBIS,
            rls.Position(4642, 0, False, False, None, 26.9),
        ),
        (b"3", "88 B8 03", AKSIM_17, rls.Position(70000, 0, False, False)),
        (
            b"1",
            "31 FF FE 48 8B",
            rls.Layout(14, True),
            rls.Position(4642, -2, False, False),
        ),
        (b"3", "44 5C 03", rls.Layout(18), rls.Position(70000, 0, False, False)),
    ],
)
def test_replies_as_they_stand_on_the_wire(request_, reply, layout, expected):
    assert rls.position(bytes.fromhex(reply), request_, layout) == expected


def test_settings_as_they_stand_on_the_wire():
    assert rls.UNLOCK + rls.continuous(rls.SHORT, 1000) == bytes.fromhex(
        "CD EF 89 AB 54 00 33 03 E8"
    )
    assert bytes.fromhex("CD EF 89 AB 53") == rls.UNLOCK + rls.START
    assert rls.STOP == b"\x50"
    assert rls.continuous(rls.POSITION, 250, autostart=True)[-2:] == b"\x00\xfa"


def test_serial_numbers():
    assert rls.serial_number(b"v21A07x") == "21A07x"
    for bad in (b"v21A07", b"x21A07x", b"v21A0\x00x", b"", b"v21A07xx"):
        assert rls.serial_number(bad) is None


@pytest.mark.parametrize("bits", [0, 9, 23])
def test_impossible_resolutions_are_refused(bits):
    with pytest.raises(ValueError, match="expected 10 to 22"):
        rls.Layout(bits)


def test_what_is_no_request_is_refused():
    with pytest.raises(ValueError, match="no request"):
        ORBIS.reply_bytes(b"s")
    with pytest.raises(ValueError, match="no header"):
        rls.Replies(rls.SHORT, ORBIS)


@given(layouts, requests, st.data())
def test_every_value_is_restored(layout, request_, data):
    count = data.draw(st.integers(0, 2**layout.bits - 1))
    turns = data.draw(st.integers(-(2**15), 2**15 - 1)) if layout.turns else 0
    flags, detail = data.draw(st.integers(0, 3)), data.draw(st.integers(0, 255))
    tenths = data.draw(st.integers(-400, 1250))
    reply = written(
        layout, request_, count, turns=turns, flags=flags, detail=detail, tenths=tenths
    )
    assert len(reply) == layout.reply_bytes(request_)
    position = rls.position(reply, request_, layout)
    assert (position.count, position.turns) == (count, turns)
    assert (position.error, position.warning) == (not flags & 2, not flags & 1)
    assert position.conditions == (detail if request_ == rls.DETAILED else None)
    expected_c = tenths / 10.0 if request_ == rls.TEMPERATURE else None
    assert position.temperature_c == expected_c
    for cut in range(len(reply)):
        assert rls.position(reply[:cut], request_, layout) is None


@given(st.binary(max_size=12), requests, layouts)
def test_noise_is_no_reply_unless_it_could_be_one(noise, request_, layout):
    position = rls.position(noise, request_, layout)
    if position is not None:
        flags = (not position.error) << 1 | (not position.warning)
        tenths = round(10.0 * (position.temperature_c or 0.0))
        repeated = written(
            layout,
            request_,
            position.count,
            turns=position.turns,
            flags=flags,
            detail=position.conditions or 0,
            tenths=tenths,
        )
        assert repeated == noise


def chunks(data, sizes):
    offset = 0
    for size in sizes:
        yield data[offset : offset + size]
        offset += size
    yield data[offset:]


@given(
    st.lists(st.integers(0, 16383), min_size=3, max_size=30),
    st.lists(st.integers(0, 9), max_size=20),
)
def test_a_stream_may_be_cut_anywhere(counts, sizes):
    data = b"".join(written(ORBIS, rls.POSITION, count) for count in counts)
    replies = rls.Replies(rls.POSITION, ORBIS)
    positions = [
        position for chunk in chunks(data, sizes) for position in replies.feed(chunk)
    ]
    # The last ones are believed once they are confirmed: all, when in step.
    assert [position.count for position in positions] == counts
    assert replies.skipped == 0


@given(
    st.binary(max_size=40), st.lists(st.integers(0, 16383), min_size=40, max_size=60)
)
def test_a_stream_is_found_again_after_noise(noise, counts):
    replies = rls.Replies(rls.DETAILED, ORBIS)
    data = noise + b"".join(written(ORBIS, rls.DETAILED, count) for count in counts)
    positions = [position.count for position in replies.feed(data)]
    assert positions[-10:] == counts[-10:] or positions[-9:] == counts[-10:-1]
    assert len(replies._kept) <= 3 * 5


@given(st.lists(st.binary(max_size=60), max_size=30), layouts)
def test_a_stream_of_noise_never_grows(pieces, layout):
    replies = rls.Replies(rls.POSITION, layout)
    size = layout.reply_bytes(rls.POSITION)
    n_found = sum(len(replies.feed(piece)) for piece in pieces)
    n_bytes = sum(map(len, pieces))
    assert len(replies._kept) <= 2 * size + 1
    assert n_found * size + replies.skipped + len(replies._kept) == n_bytes

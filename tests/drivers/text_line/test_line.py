"""Lines written by hand after boards' output, and other bytes that may arrive."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from traverse.drivers.text_line.line import (
    MAX_LINE,
    Line,
    LinePattern,
    LineSplitter,
    OddLine,
)
from traverse.drivers.text_line.options import TextLineOptions

TOY = "POS,{time},{skip},{skip},{skip},{joint},{joint},{joint},{joint}"
BL = "*** E0: {joint}, E1: {joint}, E2: {joint}, E3: {joint}, E4: {joint}"
SKETCH = "$TRV,{seq},{time},{joint},{joint},{buttons}*{checksum}"


def xor(body: bytes) -> bytes:
    total = 0
    for byte in body:
        total ^= byte
    return b"%02X" % total


def toy(**keys):
    return LinePattern(TOY, "deg", (36_000,) * 4, **keys)


def sketch():
    return LinePattern(SKETCH, "counts", (4096, 4096), checksum="xor")


def signed(body: bytes) -> bytes:
    return b"$" + body + b"*" + xor(body)


def test_golden_lines():
    line = b"POS,123456,312.001,-4.250,88.900,0.00,-90.00,359.99,725.50"
    assert toy().read(line) == Line((0, 27_000, 35_999, 550), ticks=123_456)
    bl = b"   *** E0: 183.50,  E1: 41.85,  E2: -138.00,  E3: 0.00,  E4: 86.25"
    read = LinePattern(BL, "deg", (36_000,) * 5).read(bl)
    assert read == Line((18_350, 4185, 22_200, 0, 8625))
    assert sketch().read(signed(b"TRV,7,1234,100,4095,2")) == Line(
        (100, 4095), 1234, 7, 2
    )


def test_a_checksum_of_a_standard_is_the_same():
    # A sentence of NMEA 0183 with its published check sum 47.
    body = b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47"
    pattern = LinePattern(
        "$GPGGA,{joint},{skip}*{checksum}", "counts", (1 << 32,), checksum="xor"
    )
    assert pattern.read(body) == Line((123_519,))
    assert pattern.read(body.replace(b"M,,", b"M,1,")) == OddLine(
        "has a wrong checksum"
    )


@pytest.mark.parametrize(
    "raw",
    [
        b"POS,1,0,0,0,1.00,2.00,3.00",  # cut
        b"POS,1,0,0,0,1.00,2.00,3.00,4.00,5.00",  # one field more
        b"POS,1,0,0,0,1.00,2.00,3.0POS,2,0,0,0,1.00,2.00,3.00,4.00",  # merged
        b"POS,1,0,0,0,nan,2.00,3.00,4.00",
        b"POS,1,0,0,0,inf,2.00,3.00,4.00",
        b"POS,1,0,0,0,1e3,2.00,3.00,4.00",
        b"POS,1,0,0,0,,2.00,3.00,4.00",
        b"POS,-1,0,0,0,1.00,2.00,3.00,4.00",
        b"POS,1.5,0,0,0,1.00,2.00,3.00,4.00",
        b"POS,1,0,0,0,1.00,2.00,3.00,4.0",  # a digit lost
        b"POS,1,0,0,0,1.00,2.00,3.00,99999999999.00",
        b"POS,1,0,0,0,1.00,2.00,3.00,4.00\xff",
        b"",
    ],
)
def test_a_line_that_is_not_whole_is_not_read(raw):
    assert isinstance(toy(decimals=2).read(raw), OddLine)


def test_every_changed_byte_is_found_by_the_checksum():
    good = signed(b"TRV,7,1234,100,4095,2")
    for place in range(len(good)):
        for bit in range(8):
            struck = bytearray(good)
            struck[place] ^= 1 << bit
            line = sketch().read(bytes(struck))
            # A letter of the check sum may change its case alone, or begin a blank.
            assert isinstance(line, OddLine) or line == sketch().read(good)


@given(st.binary(max_size=200))
def test_no_bytes_raise(data):
    for pattern in (toy(), sketch()):
        assert isinstance(pattern.read(data), Line | OddLine)


@given(
    st.lists(st.integers(-(10**9), 10**9), min_size=2, max_size=2),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**32 - 1),
    st.integers(0, 255),
)
def test_what_is_printed_is_read(counts, seq, ms, buttons):
    body = f"TRV,{seq},{ms},{counts[0]},{counts[1]},{buttons}".encode()
    expected = Line(tuple(count % 4096 for count in counts), ms, seq, buttons)
    assert sketch().read(signed(body)) == expected


@given(st.binary(max_size=2000), st.lists(st.integers(1, 50), max_size=50))
def test_any_division_gives_the_same_lines(data, sizes):
    data = data.replace(b"\r", b"\n")
    undivided, parts = LineSplitter(), LineSplitter()
    lines, rest = [], data
    for size in sizes:
        lines += parts.feed(rest[:size])
        rest = rest[size:]
    lines += parts.feed(rest)
    assert lines == undivided.feed(data)
    assert undivided.overlong == parts.overlong
    assert len(parts._buffer) <= MAX_LINE


@pytest.mark.parametrize("end", [b"\n", b"\r", b"\r\n"])
def test_lines_end_as_the_board_likes(end):
    splitter = LineSplitter()
    assert splitter.feed(b"rest" + end + b"1,2" + end + b"3,4" + end) == [
        b"1,2",
        b"3,4",
    ]


def test_a_line_without_end_is_bounded_and_costs_itself_only():
    splitter = LineSplitter()
    assert splitter.feed(b"half\nwhole\r\n") == [b"whole"]
    for _ in range(100):
        assert splitter.feed(b"x" * 1000) == []
        assert len(splitter._buffer) <= MAX_LINE
    assert splitter.feed(b"\nnext\n") == [b"next"]
    assert splitter.overlong == 1


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"pattern": "{time}"}, "no {joint}"),
        ({"pattern": "{joint}{joint}"}, "without a separator"),
        ({"pattern": "{joint},{angle}"}, "no field {angle}"),
        ({"pattern": "{joint},{"}, "single brace"),
        ({"pattern": "{joint},{joint}"}, "expected as many"),
        ({"pattern": "{time},{time},{joint}"}, "more than once"),
        ({"pattern": "{joint}*{checksum}"}, "belong together"),
        ({"checksum": "xor"}, "belong together"),
        ({"pattern": "{joint},{button},{buttons}"}, "keep one"),
        ({"counts_per_turn": (1,)}, "2 to 2^32"),
        ({"ignore": ("",)}, "fits every line"),
        ({"start_command": "a\nb"}, "one line"),
        ({"pattern": "\u00e4{joint}"}, "not ASCII"),
    ],
)
def test_odd_options_are_refused_with_the_reason(keys, words):
    with pytest.raises(ValidationError) as refused:
        TextLineOptions(
            **{"port": "p", "pattern": "{joint}", "counts_per_turn": (4096,), **keys}
        )
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("unit", "words", "counts_per_turn", "step"),
    [
        ("rad", "0.30,-0.41", 1 << 16, 104.3),  # Arduino prints two digits
        ("deg", "17.19,-23.49", 1 << 20, 29.13),
        ("deg", "17.1912,-23.4", 36_000, 1.0),
        ("deg", "17.19,-23.49", 36_000, 1.0),
        ("counts", "300,-400", 1 << 16, None),
    ],
)
def test_angles_are_known_to_their_digits(unit, words, counts_per_turn, step):
    pattern = LinePattern("A,{joint},{joint}", unit, (counts_per_turn,) * 2)
    assert isinstance(pattern.read(b"A," + words.encode()), Line)
    expected = () if step is None else (step, step)
    assert pattern.steps_counts == pytest.approx(expected, rel=1e-3)

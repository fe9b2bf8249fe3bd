"""Commands out of bytes: the grammar of the specification, and no more."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.client.gateways.ippdme.test_conversations import Bench
from traverse.client.gateways.ippdme.grammar import (
    MAX_LINE,
    Command,
    IppError,
    LineBuffer,
    Property,
    Word,
    number,
    parse,
    property_text,
)

REPLY = re.compile(
    r"(?:[0-9]{5}|E[0-9]{4}) (?:[&%]|# .+|"
    r'! Error\([0-9],[0-9]{4},"[ !#-~]+","[ !#-~]+"\))'
)
NUMBERS = st.floats(-1e15, 1e15, allow_nan=False)
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9]{0,8}", fullmatch=True)
TEXTS = st.from_regex(r"[ !#-~]{1,20}", fullmatch=True)
SPACES = st.sampled_from(["", " ", "   "])
WORDS = ["00001", "E0001", "E0000", "Get", "X", "1.5", "e9", "a", "Home()"]
PIECES = st.sampled_from([*WORDS, *' (),.-"\r\n\0\xff', "\r\n", "PtMeas(X(1))"])


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("00001 Home()", Command("00001", "Home")),
        ("E9999 Get ( X ( ) )", Command("E9999", "Get", (Property("X"),))),
        (
            'E0001 A("b c" , 1.,.5 ,-2e-3,E0001,F.g(1 , 2))',
            Command(
                "E0001",
                "A",
                ("b c", 1.0, 0.5, -0.002, Word("E0001"), Property("F.g", (1.0, 2.0))),
            ),
        ),
    ],
)
def test_what_the_grammar_allows(line: str, expected: Command) -> None:
    assert parse(line.encode() + b"\r\n") == expected


@pytest.mark.parametrize(
    ("line", "number", "tag"),
    [
        (b"00000 Home()\r\n", 1, "E0000"),
        (b"E0000 Home()\r\n", 1, "E0000"),
        (b"20 Home()\r\n", 1, "E0000"),
        (b"A4711 Home()\r\n", 1, "E0000"),
        (b"\r\n", 1, "E0000"),
        (b"00001\r\n", 2, "00001"),
        (b"00001\tHome()\r\n", 7, "00001"),
        (b"00001 Home()\n", 7, "00001"),
        (b"00001 Ho\rme()\r\n", 7, "00001"),
        (b"00001 Hom\xe9()\r\n", 7, "00001"),
        (b"00001 Home\r\n", 8, "00001"),
        (b"00001 Home() \r\n", 8, "00001"),
        (b"00001 A.b()\r\n", 8, "00001"),
        (b"00001 A(b.c)\r\n", 8, "00001"),
        (b"00001 A(,)\r\n", 8, "00001"),
        (b"00001 A(1,)\r\n", 8, "00001"),
        (b'00001 A("")\r\n', 8, "00001"),
        (b"00001 A(B(C()))\r\n", 8, "00001"),
        (b"00001 A(.)\r\n", 8, "00001"),
        (b"00001 A(12345678901234567)\r\n", 8, "00001"),
        (b"00001 A(1e999)\r\n", 509, "00001"),
        (b"00001 " + b" " * MAX_LINE + b"\r\n", 8, "00001"),
    ],
)
def test_what_it_does_not(line: bytes, number: int, tag: str) -> None:
    with pytest.raises(IppError) as raised:
        parse(line)
    assert (raised.value.number, raised.value.tag) == (number, tag)


@pytest.mark.parametrize("piece", [" ", "1", "(", ".", "1.", "a", "a.", "1,", '"'])
def test_a_long_line_takes_no_more_than_its_length(piece: str) -> None:
    # Without possessive patterns the spaces and digits alone take minutes.
    with pytest.raises(IppError):
        parse(b"00001 A(" + (piece * MAX_LINE)[: MAX_LINE - 8].encode() + b"\r\n")


@given(NAMES, st.lists(st.one_of(TEXTS, NUMBERS, NAMES.map(Word))), SPACES)
def test_what_is_written_is_read_back(
    name: str, args: list[str | float | Word], space: str
) -> None:
    shown = [
        argument.name
        if isinstance(argument, Word)
        else property_text("", argument)[1:-1]
        for argument in args
    ]
    line = f"00001 {name}{space}({space}{f'{space},{space}'.join(shown)}{space})"
    command = parse(line.encode() + b"\r\n")
    assert command.name == name
    for argument, back in zip(args, command.args, strict=True):
        if isinstance(argument, float):
            assert back == pytest.approx(argument, rel=1e-8, abs=1e-6)
        else:
            assert back == argument


@given(NUMBERS)
def test_numbers_have_at_most_sixteen_digits(value: float) -> None:
    assert sum(map(str.isdigit, number(value))) <= 16


@given(
    st.one_of(st.binary(max_size=200), st.lists(PIECES).map("".join)), st.integers(1, 9)
)
def test_any_bytes_are_answered_by_the_grammar(data: bytes | str, size: int) -> None:
    sent = data if isinstance(data, bytes) else data.encode("latin-1")
    bench, buffer, n_lines = Bench(), LineBuffer(), 0
    bench.session.take_line(b"00009 StartSession()\r\n")
    for start in range(0, len(sent), size):
        for line in buffer.lines(sent[start : start + size]):
            bench.session.take_line(line)
            n_lines += 1
    assert n_lines == sent.count(b"\n")
    assert all(REPLY.fullmatch(reply) for reply in bench.replies)
    assert len(bench.replies) >= 2 + n_lines

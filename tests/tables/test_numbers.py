"""Numbers as people write them, against values written by hand."""

import math

import pytest

from traverse.tables.numbers import MixedMarksError, NumberReader, part_of_pi


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("12.5", "other", 12.5),
        ("+.5e-3", "other", 0.0005),
        ("12,5", "other", 12.5),
        ("1,5e3", "other", 1500.0),
        ("0,125", "other", 0.125),
        ("\u221290", "deg", -90.0),
        ("\u201390", "other", -90.0),
        ("1e\u22125", "other", 1e-5),
        ("\u221290°", "deg", -90.0),
        ("90 \u00ba", "deg", 90.0),
        ("pi", "rad", math.pi),
        ("-PI/2", "rad", -math.pi / 2),
        ("\u2212\u03c0/2", "rad", -math.pi / 2),
        ("3*pi/4", "rad", 0.75 * math.pi),
        ("0.5pi", "rad", 0.5 * math.pi),
        ("1'234.5", "other", 1234.5),
        ("1\u00a0234,5", "other", 1234.5),
        ("1\u202f234\u202f567", "other", 1234567.0),
        ("1.234,5", "other", 1234.5),
        ("1,234.5", "other", 1234.5),
        ("1,234,567", "other", 1234567.0),
        ("-1.234.567", "other", -1234567.0),
    ],
)
def test_what_is_beyond_doubt_is_read(text, unit, expected):
    reader = NumberReader(",")
    assert reader.number(text, unit, 2) == expected
    assert reader.doubt() is None


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("inf", "other", "not a finite number"),
        ("nan", "other", "not a finite number"),
        ("1e400", "other", "not a finite number"),
        ("1_000", "other", "not a finite number"),
        ("0x10", "other", "not a finite number"),
        ("", "other", "not a finite number"),
        ("90°", "rad", "expected radians; it has U+00B0 DEGREE SIGN"),
        ("12°", "other", "expected no angle"),
        ("pi/2", "deg", "of degrees: parts of pi are radians"),
        ("pi/0", "rad", "or a part of pi"),
        ("1 234", "other", "U+0020 SPACE inside"),
        ("\u20145", "other", "U+2014 EM DASH"),
        ("- 5", "other", "U+0020 SPACE"),
        ("5\u200b", "other", "U+200B ZERO WIDTH SPACE"),
        ("\u0661\u0662", "other", "U+0661 ARABIC-INDIC DIGIT ONE"),
        ("12.5 mm", "other", "without unit"),
        ("1,23,456", "other", "write it like -1234.5"),
        ("1.234.5", "other", "not a finite number"),
        ("1,234,5", "other", "not a finite number"),
    ],
)
def test_what_is_no_number_is_refused_with_its_characters(text, unit, expected):
    with pytest.raises(ValueError, match="is not a finite number") as refused:
        NumberReader(",").number(text, unit, 2)
    assert expected in str(refused.value)


def test_three_digits_behind_a_comma_are_doubtful_until_another_number_decides():
    reader = NumberReader("\t")
    assert reader.number("1,234", "other", 3) == 1.234
    line, doubt = reader.doubt()
    assert line == 3
    assert doubt.startswith("'1,234' may be 1.234 or 1234: no other number")
    assert reader.number("0,5", "other", 4) == 0.5
    assert reader.doubt() is None
    reader = NumberReader("\t")
    reader.number("1,234", "other", 3)
    with pytest.raises(MixedMarksError, match=r"'1,234' in line 3.*'2.5' in line 5"):
        reader.number("2.5", "other", 5)
    reader = NumberReader("\t")
    reader.number("1,234,567", "other", 2)
    with pytest.raises(MixedMarksError):
        reader.number("1,234", "other", 3)


def test_semicolons_say_that_the_comma_is_decimal():
    reader = NumberReader(";")
    assert reader.number("1,234", "other", 2) == 1.234
    assert reader.doubt() is None


def test_integers_may_have_thousands_apart_but_no_decimals():
    reader = NumberReader(";")
    assert reader.integer("8388608", 2) == 8388608
    assert reader.integer("\u22121", 2) == -1
    assert reader.integer("9007199254740993", 2) == 9007199254740993
    for text in ("8 388 608", "8.388", "8,388", "1e3", "1.0", "", "9" * 20):
        assert reader.integer(text, 2) is None
    assert reader.integer("8.388.608", 2) == 8388608


def test_a_column_is_read_as_its_cells_are():
    cells = ["1.5", "", "-2", "x", "1e30", "+3e2"]
    reader = NumberReader(",")
    values, wrong = reader.column(cells, "other", range(2, 8))
    assert list(wrong) == [3, 4]
    assert values[[0, 2, 5]].tolist() == [1.5, -2.0, 300.0]
    assert all(math.isnan(values[row]) for row in (1, 3, 4))
    plain, wrong = NumberReader(";").column(["1,5", "", "7"], "other", range(2, 5))
    assert plain[[0, 2]].tolist() == [1.5, 7.0]
    assert wrong == {}
    with pytest.raises(MixedMarksError, match=r"'1,5' in line 9.*'1.5' in line 2"):
        reader.column(["7", "1,5"], "other", [8, 9])


@pytest.mark.parametrize("text", ["2", "pip", "pi/", "pi pi", ""])
def test_what_is_no_part_of_pi(text):
    assert part_of_pi(text) is None

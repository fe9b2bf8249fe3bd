"""Files that are none, too large, or hold needless constructs.

Strict reading of files that are no arm files.
"""

import os

import pytest

from traverse.strict_toml.files import (
    MOST_BYTES,
    MOST_LINE,
    MOST_TOML_BYTES,
    bytes_of,
    json_of,
    open_regular,
    text_lines,
)
from traverse.strict_toml.problems import MOST_SHOWN, FileError, Problem
from traverse.strict_toml.reader import StrictModel, parse_strict, read_strict


@pytest.mark.parametrize("kind", ["fifo", "endless", "folder"])
def test_only_regular_files_are_opened(tmp_path, kind):
    path = tmp_path / "file"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    refused = pytest.raises(OSError, match=r"not a regular file|Is a directory")
    for opened in (open_regular, bytes_of, json_of):
        with refused as caught:
            opened(path)
        assert caught.value.filename == str(path)  # and not a descriptor's number
    with refused, text_lines(path):
        pass


def test_a_file_that_is_read_whole_and_a_line_of_a_table_are_bounded(tmp_path):
    path = tmp_path / "file"
    path.touch()
    os.truncate(path, MOST_BYTES)
    assert len(bytes_of(path)) == MOST_BYTES
    os.truncate(path, MOST_BYTES + 1)
    with pytest.raises(OSError, match="larger than 64 MiB"):
        bytes_of(path)
    with text_lines(path) as lines, pytest.raises(ValueError, match=str(MOST_LINE)):
        list(lines)


@pytest.mark.parametrize("text", ["[" * 100_000, "[1e400]", "[-1e400]", "[NaN]", "{"])
def test_json_is_bounded_and_finite(tmp_path, text):
    path = tmp_path / "file.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"deep|range|finite|property name"):
        json_of(path)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("1e308", "rate_hz: 1e+308 is out of range; expected at most 1e+20 either way"),
        ("-1e21", "rate_hz: -1e+21 is out of range"),
        ("9" * 400, "rate_hz: 999"),
        ("1e400", "rate_hz: inf is not a finite number"),
        ('1.0\nport = "a\\u0000"', "port: 'a\\x00' has a NUL character"),
    ],
)
def test_absurd_values_are_refused_by_their_key(value, expected):
    text = f'[[device]]\nid = "a"\nrate_hz = {value}\n'
    with pytest.raises(FileError) as caught:
        parse_strict(text, "d.toml", Settings)
    assert expected in str(caught.value)


class Device(StrictModel):
    id: str
    rate_hz: float = 1.0


class Settings(StrictModel):
    device: tuple[Device, ...] = ()
    broker: Device | None = None


def no_spaces(raw):
    for index, device in enumerate(raw.get("device", [])):
        if " " in str(device.get("id")):
            yield Problem(f"device[{index}].id", "has a space")


def test_strict_reading_serves_other_files():
    text = '[[device]]\nid = "a"\nrate_hz = 5\n'
    assert parse_strict(text, "d.toml", Settings, no_spaces) == Settings(
        device=(Device(id="a", rate_hz=5.0),)
    )
    text = '[[device]]\nid = "a b"\nrate = 5\n[broker]\nId = 1\n'
    with pytest.raises(FileError) as caught:
        parse_strict(text, "d.toml", Settings, no_spaces)
    assert str(caught.value).splitlines() == [
        "d.toml: 4 problems",
        "  device[0].id: has a space",
        "  device[0].rate: unknown key 'rate'; did you mean 'rate_hz'? "
        "units are part of the name",
        "  broker.Id: unknown key 'Id'; did you mean 'id'?",
        "  broker.id: is missing; add it",
    ]


class Arm(StrictModel):
    zero_rad: float = 0.0
    axis_mm: tuple[float, float, float] | None = None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("zero_deg = 90", "unknown key 'zero_deg'; expected zero_rad = 1.57079632679"),
        ("axis_m = [0.25, 0, -1]", "expected axis_mm = [250, 0, -1000]"),
        ('zero_deg = "a"', "unknown key 'zero_deg'; expected 'zero_rad'"),
        ("axis_inch = 1", "expected axis_mm = 25.4"),
        ("length_deg = 90", "unknown key 'length_deg'; known here: axis_mm, zero_rad"),
        ("axis_mm = [250,0, 0,5, 1]", "write 250.0, not 250,0"),
        ("zero_rad = \u22121.5", "U+2212 MINUS SIGN is there"),
        ("zero_rad = 1,5", "a decimal comma: write a decimal point"),
    ],
)
def test_other_units_and_decimal_commas_are_answered_with_what_to_write(text, expected):
    with pytest.raises(FileError) as refused:
        parse_strict(text, "arm.toml", Arm)
    assert expected in str(refused.value)


def test_of_thousands_of_problems_the_first_are_shown():
    text = "".join(f"k{number} = 1\n" for number in range(2_000))
    with pytest.raises(FileError) as refused:
        parse_strict(text, "arm.toml", Arm)
    first, *lines, last = str(refused.value).splitlines()
    assert first == "arm.toml: 2000 problems"
    assert len(lines) == MOST_SHOWN
    assert last == f"  and {2000 - MOST_SHOWN} more"
    assert refused.value.line.endswith(last.strip())


def test_a_larger_file_is_not_parsed(tmp_path):
    path = tmp_path / "arm.toml"
    path.touch()
    os.truncate(path, MOST_TOML_BYTES + 1)
    with pytest.raises(FileError, match="larger than 8 MiB"):
        read_strict(path, Arm)


def test_cross_check_alone_refuses_a_file():
    with pytest.raises(FileError, match="has a space"):
        parse_strict('[[device]]\nid = "a b"\n', "d.toml", Settings, no_spaces)

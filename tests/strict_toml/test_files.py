"""Files that are none, too large, or hold what no file needs."""

import csv
import os

import pytest

from tests.strict_toml.test_strict_files import Settings
from traverse.strict_toml.files import (
    MOST_BYTES,
    MOST_LINE,
    bytes_of,
    json_of,
    open_regular,
    table_lines,
)
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import parse_strict


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
        with refused:
            opened(path)
    with refused, table_lines(path):
        pass


def test_a_file_that_is_read_whole_and_a_line_of_a_table_are_bounded(tmp_path):
    path = tmp_path / "file"
    path.touch()
    os.truncate(path, MOST_BYTES)
    assert len(bytes_of(path)) == MOST_BYTES
    os.truncate(path, MOST_BYTES + 1)
    with pytest.raises(OSError, match="larger than 64 MiB"):
        bytes_of(path)
    with table_lines(path) as lines, pytest.raises(csv.Error, match=str(MOST_LINE)):
        list(csv.reader(lines))


@pytest.mark.parametrize("text", ["[" * 100_000, "[1e400]", "[-1e400]", "[NaN]", "{"])
def test_json_is_bounded_and_finite(tmp_path, text):
    path = tmp_path / "file.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"deep|range|finite|property name"):
        json_of(path)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ("1e308", "rate_hz: 1e+308 is out of range; expected at most 1e+20 either way"),
        ("-1e21", "rate_hz: -1e+21 is out of range"),
        ("9" * 400, "rate_hz: 999"),
        ("1e400", "rate_hz: inf is not a finite number"),
        ('1.0\nport = "a\\u0000"', "port: 'a\\x00' has a NUL character"),
    ],
)
def test_absurd_values_are_refused_by_their_key(value, said):
    text = f'[[device]]\nid = "a"\nrate_hz = {value}\n'
    with pytest.raises(FileError) as caught:
        parse_strict(text, "d.toml", Settings)
    assert said in str(caught.value)

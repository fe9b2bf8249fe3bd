"""Integers as differences: nothing is lost, and nothing else is read."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from traverse.recording.differences import bytes_to_differences, differences_to_bytes
from traverse.recording.maps import bytes_to_map, map_to_bytes

KINDS = [f"{kind}{size}" for kind in "iu" for size in (1, 2, 4, 8)]
SHAPES = array_shapes(min_dims=1, max_dims=2, min_side=0, max_side=12)


@given(st.data(), st.sampled_from(KINDS), SHAPES)
def test_any_integers_come_back(data, kind, shape):
    array = data.draw(arrays(kind, shape))
    found = bytes_to_differences(differences_to_bytes(array))
    assert found.dtype == array.dtype
    assert found.shape == array.shape
    assert (found == array).all()


def test_bytes_are_those_of_the_table():
    # Two columns; rows 100 7, 101 5, 103 3: differences 1 2 and -2 -2 in one byte.
    array = np.array([[100, 7], [101, 5], [103, 3]], np.uint32)
    head = bytes([ord("u"), 4, 2, 1, 3, 0, 0, 0, 2, 0, 0, 0])
    first = bytes([100, *[0] * 7, 7, *[0] * 7])
    assert differences_to_bytes(array) == head + first + bytes([1, 2, 254, 254])
    steady = np.arange(1000, 2000, 10)
    assert len(differences_to_bytes(steady)) == 12 + 8 + 8  # w = 0


def test_a_stream_takes_few_bytes():
    rng = np.random.default_rng(3)
    n = 200
    counts = np.cumsum(rng.integers(-90, 90, (n, 7)), axis=0) % (1 << 23)
    assert len(differences_to_bytes(counts.astype(np.uint32))) < n * 7 * 4.3
    steady = np.cumsum(rng.integers(-90, 90, (n, 7)), axis=0) + (1 << 20)
    assert len(differences_to_bytes(steady.astype(np.uint32))) < n * 7 * 1.2


@given(st.binary(max_size=80))
def test_no_bytes_crash_the_reader(content):
    try:
        bytes_to_differences(content)
    except ValueError:
        return


@given(st.data())
def test_a_changed_array_is_read_or_refused(data):
    content = bytearray(differences_to_bytes(np.arange(20).reshape(10, 2) ** 2))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] = data.draw(st.integers(0, 255))
    try:
        assert bytes_to_differences(bytes(content)).size <= 1 << 22
    except ValueError:
        return


@given(st.binary(max_size=60))
def test_maps_are_read_or_refused(content):
    try:
        assert isinstance(bytes_to_map(content), dict)
    except ValueError:
        return


def test_maps_hold_plain_values_and_arrays():
    table = {"a": 1, "b": None, "c": [1.5, "x"], "d": {"e": np.arange(3)}}
    found = bytes_to_map(map_to_bytes(table))
    assert found["c"] == (1.5, "x")
    assert (found["d"]["e"] == np.arange(3)).all()
    floats = bytes_to_map(map_to_bytes({"f": np.array([[0.1, -0.0]])}))["f"]
    assert floats.tobytes() == np.array([[0.1, -0.0]]).tobytes()
    with pytest.raises(TypeError, match="set in a map"):
        map_to_bytes({"a": {1}})

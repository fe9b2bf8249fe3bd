"""Arrays as a MessagePack extension: layout by hand, laws, and hostile content."""

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from traverse.protocol.arrays import array_to_bytes, bytes_to_array
from traverse.protocol.message_error import MessageError

DTYPES = (
    "bool int8 int16 int32 int64 uint8 uint16 uint32 uint64 float16 float32 float64"
)

# kind, size, dimensions; each dimension; each element: see the module's table.
BY_HAND = {
    "75 02 02  01 00 00 00  03 00 00 00  01 00  02 00  03 02": np.array(
        [[1, 2, 515]], np.uint16
    ),
    "66 08 01  02 00 00 00  00 00 00 00 00 00 F0 3F  00 00 00 00 00 00 00 C0": (
        np.array([1.0, -2.0])
    ),
    "69 04 01  02 00 00 00  FF FF FF FF  00 00 00 80": np.array(
        [-1, -(2**31)], np.int32
    ),
    "62 01 01  03 00 00 00  01 00 01": np.array([True, False, True]),
    "66 08 02  00 00 00 00  03 00 00 00": np.zeros((0, 3)),
}
HOSTILE = {
    "": "head of at least 3 bytes",
    "66 08": "head of at least 3 bytes",
    "66 08 02  01 00 00 00": "a head of 11 bytes",
    "66 08 00": "0 dimensions",
    "66 08 05" + " 01 00 00 00" * 5: "5 dimensions",
    "66 03 01  00 00 00 00": "elements of 3 bytes",
    "66 10 01  00 00 00 00": "elements of 16 bytes",
    "4F 08 01  01 00 00 00" + " 00" * 8: "kind 0x4f",
    "66 08 01  02 00 00 00" + " 00" * 8: "expected 23 bytes",
    "66 08 01  01 00 00 00" + " 00" * 9: "expected 15 bytes",
    "66 08 04" + " FF FF FF FF" * 4: "expected",
    "66 08 04  00 00 00 00" + " FF FF FF FF" * 3: "a possible shape",
    "62 01 01  02 00 00 00  01 02": "neither 00 nor 01",
}


@pytest.mark.parametrize("listing", BY_HAND)
def test_layout_is_the_documented_one(listing):
    array = BY_HAND[listing]
    assert array_to_bytes(array) == bytes.fromhex(listing)
    read = bytes_to_array(bytes.fromhex(listing))
    assert read.dtype == array.dtype
    np.testing.assert_array_equal(read, array, strict=True)


def test_documented_example_stands_in_messagepack_as_written():
    listing = "C7 11 01  75 02 02  01 00 00 00  03 00 00 00  01 00  02 00  03 02"
    extension = msgpack.unpackb(bytes.fromhex(listing))
    assert extension.code == 1
    np.testing.assert_array_equal(bytes_to_array(extension.data), [[1, 2, 515]])


@given(
    st.sampled_from(DTYPES.split()).flatmap(
        lambda dtype: arrays_of.arrays(
            dtype, arrays_of.array_shapes(max_dims=4, min_side=0, max_side=5)
        )
    )
)
def test_every_array_is_restored_bit_for_bit(array):
    read = bytes_to_array(array_to_bytes(array))
    assert read.dtype == array.dtype
    assert read.shape == array.shape
    assert read.tobytes() == array.tobytes()


def test_order_and_byte_order_in_memory_do_not_matter():
    array = np.arange(6, dtype=np.int32).reshape(2, 3)
    content = array_to_bytes(array)
    assert array_to_bytes(np.asfortranarray(array)) == content
    assert array_to_bytes(array.astype(">i4")) == content
    assert array_to_bytes(np.repeat(array, 2, axis=1)[:, ::2]) == content


def test_what_was_read_cannot_be_written_to():
    read = bytes_to_array(array_to_bytes(np.zeros(3)))
    with pytest.raises(ValueError, match="read-only"):
        read[0] = 1.0


@pytest.mark.parametrize("array", [np.array("text"), np.array([None]), np.array(1.0)])
def test_other_dtypes_and_scalars_are_refused(array):
    with pytest.raises(MessageError):
        array_to_bytes(array)


@pytest.mark.parametrize("listing", HOSTILE)
def test_content_that_breaks_the_layout_is_refused(listing):
    with pytest.raises(MessageError, match=HOSTILE[listing]):
        bytes_to_array(bytes.fromhex(listing))


@given(st.binary(max_size=40))
def test_arbitrary_content_gives_an_array_or_a_message_error(content):
    try:
        array = bytes_to_array(content)
    except MessageError:
        return
    if array.size:
        assert array_to_bytes(array) == content

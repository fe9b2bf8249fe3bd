import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.protocol.modbus import PositionRegisters

WORDS = st.integers(0, 0xFFFF)


def registers(words=2, *, order="high", signed=False, scale=1.0, modulus=2**32):
    return PositionRegisters(0, words, order, signed, scale, modulus)


@pytest.mark.parametrize(
    ("layout", "words", "count"),
    [
        (registers(1, modulus=2**16), [0x13C5], 5061),  # Lika's manual
        (registers(), [0x0001, 0xE240], 123456),
        (registers(order="low"), [0xE240, 0x0001], 123456),
        (registers(signed=True, modulus=1000), [0xFFFF, 0xFFFF], 999),
        (registers(1, scale=0.1, modulus=3600), [35994], 3599),
        (registers(1, scale=0.1, modulus=3600), [35997], 0),
        (registers(4, modulus=2**31 + 1), [0, 1, 0, 0x0007], 5),
        # in another order, without the turns, a float of 180
        (registers(modulus=2**13), [5000, 0], None),
        (registers(4, modulus=2**20), [0, 0, 0x0010, 0x0007], None),
        (registers(modulus=2**16), [0x4334, 0], None),
    ],
)
def test_words_make_a_count(layout, words, count):
    assert layout.count(words) == count


@given(st.sampled_from([1, 2, 4]), st.integers(2, 2**32), st.booleans(), st.data())
def test_a_count_is_below_the_modulus_whatever_is_read(n, modulus, signed, data):
    words = data.draw(st.lists(WORDS, min_size=n, max_size=n))
    scale = data.draw(st.sampled_from([1.0, 0.1, 7.5]))
    layout = registers(n, signed=signed, scale=scale, modulus=modulus)
    count = layout.count(words)
    assert count is None or 0 <= count < modulus


@given(st.integers(0, 2**32 - 1))
def test_the_order_of_words_is_all_that_differs(value):
    high, low = divmod(value, 65536)
    assert registers().count([high, low]) == value
    assert registers(order="low").count([low, high]) == value


@pytest.mark.parametrize("words", [[], [1], [1, 2, 3]])
def test_another_number_of_words_is_refused(words):
    with pytest.raises(ValueError, match="expected 2"):
        registers().count(words)

"""Nominal places as people write them."""

import pytest

from traverse.client.page.part_alignment import place_of


@pytest.mark.parametrize(
    "text",
    ["12.5 0 -3", "12,5 0 -3", "12.5, 0, -3", "12.5;0;-3", "12.5,0,-3", " 12,5;0 ; -3"],
)
def test_three_numbers_are_a_place(text):
    assert place_of("circle 1", text) == (12.5, 0.0, -3.0)


@pytest.mark.parametrize("text", ["1 2", "1,2", "a b c", "1 2 3 4", "12,5,0,-3"])
def test_anything_else_is_refused(text):
    with pytest.raises(ValueError, match=f"circle 1: '{text}' is no place; write"):
        place_of("circle 1", text)

"""Registers of Modbus encoders: words of 16 bits, and their values.

pymodbus deals with the frames; this module with the meaning of their data.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

MOST_COUNTS = 1 << 32  # of an encoder's turns


@dataclass(frozen=True, slots=True)
class PositionRegisters:
    """Where an encoder keeps its position, and in which form.

    Attributes:
        first: Number of the first register, from 0.
        word_order: The first word, "high" or "low".
        signed: The highest bit means minus.
        scale: Counts for one unit of the read value.
        modulus: Count at which it wraps to 0.
    """

    first: int
    words: int
    word_order: Literal["high", "low"]
    signed: bool
    scale: float
    modulus: int

    def count(self, words: Sequence[int]) -> int | None:
        """Return the count, from 0 to below the modulus; None if it is beyond.

        An encoder sends nothing beyond its modulus: the meaning of the words, or the
        modulus, is another one. Where its real one has no place in 32 bits, the
        position is taken modulo.

        Raises:
            ValueError: Not so many words as expected.
        """
        if len(words) != self.words:
            raise ValueError(f"{len(words)} words; expected {self.words}")
        value = 0
        for word in words if self.word_order == "high" else reversed(words):
            value = value << 16 | word
        if self.signed and value >> (16 * self.words - 1):
            value -= 1 << 16 * self.words
        if self.scale != 1.0:
            value = round(value * self.scale)  # to the modulus itself, perhaps
        may_be_larger = 2 * self.modulus > MOST_COUNTS
        if not (-self.modulus <= value <= self.modulus or may_be_larger):
            return None
        return value % self.modulus

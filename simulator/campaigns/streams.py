"""Independent random numbers for every purpose, all from one seed."""

from typing import Literal

import numpy as np

Purpose = Literal[
    "placement", "contacts", "conditions", "encoders", "touch", "certificates",
    "directions", "blunders", "sizes",
]  # fmt: skip

_TAGS: dict[Purpose, int] = {
    "placement": 0x706C,
    "contacts": 0x636F,
    "conditions": 0x6364,
    "encoders": 0x656E,
    "touch": 0x746F,
    "certificates": 0x6365,
    "directions": 0x6469,
    "blunders": 0x626C,
    "sizes": 0x7369,
}


def stream(seed: int, purpose: Purpose) -> np.random.Generator:
    """Random numbers that no other purpose of the same seed shares.

    So that, say, more blunders leave every other drawn value as it was.
    """
    return np.random.default_rng([seed, _TAGS[purpose]])

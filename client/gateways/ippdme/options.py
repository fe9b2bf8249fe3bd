"""Options of the I++ DME server."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class Options:
    """The user's choices.

    Attributes:
        near_mm: greatest distance of a touch from its target for `PtMeas`; the ball's
            radius is added.
        radii_mm: radii of balls by tool, as far as known.
        keys: names of keys by input, such as "base/1".
    """

    near_mm: float = 10.0
    radii_mm: Mapping[str, float] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    machine_class: Literal["CartCMM", '"CartCMM"'] = "CartCMM"

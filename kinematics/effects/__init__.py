"""Physical effects beyond the geometry, a class each; `effect_class` finds them."""

import pkgutil
from collections.abc import Iterator
from functools import cache
from importlib import import_module

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects import contacts, mechanics, readings
from traverse.kinematics.effects.base.correction import Correction

__all__ = ["effect_class"]


def effect_class(kind: str) -> type[Correction]:
    """Find the class of a kind; the first call imports all of them."""
    return _classes()[kind]


@cache
def _classes() -> dict[str, type[Correction]]:
    found = dict(_laws())
    return {kind: found[kind] for kind in EFFECT_KINDS}


def _laws() -> Iterator[tuple[str, type[Correction]]]:
    """Go through the classes of all modules that have a kind of their own."""
    for folder in (readings, mechanics, contacts):
        for found in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}."):
            for law in vars(import_module(found.name)).values():
                if isinstance(law, type) and issubclass(law, Correction):
                    yield vars(law).get("kind", ""), law

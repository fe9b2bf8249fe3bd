"""Physical effects beyond the geometry, a class each; `EFFECTS` finds them by kind."""

import pkgutil
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import MappingProxyType

from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects import contacts, mechanics, readings
from traverse.kinematics.effects.base.correction import Correction

__all__ = ["EFFECTS"]


def _laws() -> Iterator[tuple[str, type[Correction]]]:
    """Go through the classes of all modules that have a kind of their own."""
    for folder in (readings, mechanics, contacts):
        for found in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}."):
            for law in vars(import_module(found.name)).values():
                if isinstance(law, type) and issubclass(law, Correction):
                    yield vars(law).get("kind", ""), law


_OF_KIND = dict(_laws())
EFFECTS: Mapping[str, type[Correction]] = MappingProxyType(
    {kind: _OF_KIND[kind] for kind in EFFECT_KINDS}
)

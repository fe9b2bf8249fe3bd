"""Physical effects beyond the geometry, a class each; `effect_class` finds them."""

import pkgutil
from functools import cache
from importlib import import_module

from traverse.extensions import (
    EFFECT_GROUP,
    load_extension_class,
)
from traverse.kinematics.effects import contacts, mechanics, readings
from traverse.kinematics.effects.base.correction import Correction

__all__ = ["effect_class"]


def effect_class(kind: str) -> type[Correction]:
    """Find the class of a kind; the first call imports all of Traverse.

    Raises:
        BrokenExtensionError: another package offers the kind, and it cannot be used.
    """
    built_in = _classes().get(kind)
    if built_in is not None:
        return built_in
    return load_extension_class(EFFECT_GROUP, kind, Correction)


@cache
def _classes() -> dict[str, type[Correction]]:
    return {
        vars(law).get("kind", ""): law
        for folder in (readings, mechanics, contacts)
        for module in pkgutil.iter_modules(folder.__path__, f"{folder.__name__}.")
        for law in vars(import_module(module.name)).values()
        if isinstance(law, type) and issubclass(law, Correction)
    }

"""Additions of other packages to Traverse, by entry points of their metadata.

A package is imported when something of it is used, not before. Names that Traverse has
itself come first: no package can take them.
"""

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

DRIVER_GROUP = "traverse.drivers"
EXPORT_GROUP = "traverse.exports"
EFFECT_GROUP = "traverse.effects"
LAW_GROUP = "traverse.simulator_laws"
GATEWAY_GROUP = "traverse.gateways"

Kind = TypeVar("Kind")


class BrokenExtensionError(ValueError):
    """An offer of a package cannot be used; states which package, and why."""


@cache
def offered_extensions(group: str) -> Mapping[str, tuple["EntryPoint", ...]]:
    """Return the entry points of a group by name; several where packages disagree."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - takes 10 ms

    by_name: dict[str, tuple[EntryPoint, ...]] = {}
    for entry in entry_points(group=group):
        if entry not in by_name.get(entry.name, ()):
            by_name[entry.name] = (*by_name.get(entry.name, ()), entry)
    return by_name


def load_extension(group: str, name: str, kind: type[Kind]) -> Kind:
    """Import a package's object under a name.

    Args:
        group: of the entry point.
        name: of the entry point.
        kind: of which it must be an instance; a metaclass, where it is a class.

    Raises:
        KeyError: no package offers it.
        BrokenExtensionError: it cannot be imported, or is something else.
    """
    entry, *rivals = offered_extensions(group)[name]
    if rivals:
        packages = ", ".join(package_of(each) for each in (entry, *rivals))
        raise BrokenExtensionError(
            f"{name!r} ({group}) is offered by several packages: {packages}; "
            "remove all but one"
        )
    try:
        offer = entry.load()
    except Exception as error:  # a stranger's module may raise anything
        reason = f"cannot be imported: {type(error).__name__}: {error}"
        raise broken_extension(group, entry, reason) from error
    if not isinstance(offer, kind):
        raise broken_extension(group, entry, f"is no {kind.__name__} but {offer!r}")
    return offer


def load_extension_class(group: str, name: str, base: type[Kind]) -> type[Kind]:
    """Import a class that a package offers; it must be a child of ``base``.

    Raises:
        KeyError: no package offers it.
        BrokenExtensionError: it cannot be imported, or is something else.
    """
    offer = load_extension(group, name, type)
    if not issubclass(offer, base):
        reason = f"is no child of {base.__module__}.{base.__name__}"
        raise broken_extension(group, offered_extensions(group)[name][0], reason)
    return offer


def package_of(entry: "EntryPoint") -> str:
    """Return name and version of the package with an entry point."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "unknown"


def broken_extension(
    group: str, entry: "EntryPoint", reason: str
) -> BrokenExtensionError:
    """Return the error about an entry point that cannot be used, and why."""
    return BrokenExtensionError(
        f"{entry.name!r} ({group}) of package {package_of(entry)}, {entry.value}, "
        f"{reason}; repair or uninstall that package"
    )

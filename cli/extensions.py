"""`traverse extensions`: additions of other packages, and whether they can be used."""

import dataclasses
from collections.abc import Callable, Collection
from dataclasses import dataclass

import typer

from traverse.cli.common.options import Json
from traverse.cli.common.refusals import FAILED, print_report
from traverse.extensions import (
    DRIVER_GROUP,
    EFFECT_GROUP,
    EXPORT_GROUP,
    GATEWAY_GROUP,
    LAW_GROUP,
    BrokenExtensionError,
    load_extension,
    offered_extensions,
    package_of,
)


@dataclass(frozen=True, slots=True)
class Offer:
    """An offer of a package.

    Attributes:
        group: drivers, exports, effects, simulator_laws or gateways.
        name: under which it is used.
        package: name and version.
        problem: why it cannot be used; empty if it can.
    """

    group: str
    name: str
    package: str
    problem: str


def extensions(as_json: Json = False) -> None:
    """List drivers, formats, effects and gateways that other packages add.

    Each is imported, to see whether it can be used. Exit status 1 if one cannot.
    """
    offers = [
        Offer(
            group.removeprefix("traverse."),
            name,
            ", ".join(map(package_of, entries)),
            _problem(name, built_in, use),
        )
        for group, (built_in, use) in _tables().items()
        for name, entries in sorted(offered_extensions(group).items())
    ]
    lines = [
        f"{offer.group:<15}{offer.name:<24}{offer.package:<32}{offer.problem or 'ok'}"
        for offer in offers
    ]
    report = [dataclasses.asdict(offer) for offer in offers]
    print_report(report, lines or ["no package adds anything"], as_json=as_json)
    if any(offer.problem for offer in offers):
        raise typer.Exit(FAILED)


def _tables() -> dict[str, tuple[Collection[str], Callable[[str], object]]]:
    """Return by group the built-in names and the function that loads others."""
    from traverse.cli.gateway.command import BUILT_IN
    from traverse.cli.gateway.installed import load_gateway
    from traverse.client.exports.formats import FORMATS, format_class
    from traverse.drivers.base.registry import DRIVERS, driver_class
    from traverse.kinematics.effect_table import EFFECT_KINDS
    from traverse.kinematics.effects import effect_class
    from traverse.simulator.effects.laws import PLAYED

    def effect(kind: str) -> tuple[object, object]:
        return EFFECT_KINDS[kind], effect_class(kind)

    def law(kind: str) -> object:
        return load_extension(LAW_GROUP, kind, object)

    return {
        DRIVER_GROUP: (DRIVERS, driver_class),
        EXPORT_GROUP: (FORMATS, format_class),
        EFFECT_GROUP: (EFFECT_KINDS.built_in, effect),
        LAW_GROUP: (PLAYED, law),
        GATEWAY_GROUP: (BUILT_IN, load_gateway),
    }


def _problem(name: str, built_in: Collection[str], use: Callable[[str], object]) -> str:
    if name in built_in:
        return "not used: Traverse has one of that name"
    try:
        use(name)
    except BrokenExtensionError as error:
        return str(error)
    return ""

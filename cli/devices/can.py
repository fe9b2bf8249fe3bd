"""`traverse can`: who is on a CAN bus, and presets of encoders by hand."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from traverse.cli.common.options import CommandGroup, Json, Yes
from traverse.cli.common.refusals import device_errors, print_report, refuse
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.drivers.canopen.commissioning import Commissioning, FoundNode

can = CommandGroup(
    "can",
    help="CANopen encoders on a CAN bus: scan, preset. "
    "The daemon must not be using the bus.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BusOptions:
    """Which bus, in the order of `--help`.

    Attributes:
        channel: Channel of the interface: can0, /dev/ttyACM0, ...
        interface: Of python-can: socketcan, slcan, ...
        bitrate: Of the bus; SocketCAN has its own.
        timeout: Time limit of an answer in seconds.
    """

    channel: str
    interface: str = "socketcan"
    bitrate: Annotated[int, typer.Option(min=10_000, max=1_000_000)] = 1_000_000
    timeout: Annotated[float, typer.Option(min=0.01, max=10.0)] = 0.5


@can.command()
def scan(*, bus: BusOptions, as_json: Json = False) -> None:
    """List the nodes that answer: identity, profile, resolution, alarms."""
    with _opened(bus) as tool:
        nodes = [_report(node) for node in tool.scan()]
        name = tool.name
    lines = [*map(_line, nodes), f"{counted(len(nodes), 'node')} on {name}"]
    print_report({"bus": name, "nodes": nodes}, lines, as_json=as_json)


@can.command()
def preset(
    *,
    bus: BusOptions,
    node: Annotated[int, typer.Option(min=1, max=127)],
    value: Annotated[int, typer.Option(min=0)],
    store: bool = False,
    yes: Yes = False,
    as_json: Json = False,
) -> None:
    """Make the present position of an encoder a number; the shaft must rest.

    An arm file and an identification made before no longer fit: their zero_rad belongs
    to the old numbers. Exit status 3: also if the encoder refuses.

    Args:
        node: Number of the encoder.
        value: New position, counts.
        store: Store it in the encoder permanently.
    """
    with _opened(bus) as tool:
        facts = tool.facts(node)
        # With --json this is printed where the question is.
        text = f"node {node} is at {facts.position} of {facts.modulus}"
        typer.echo(text, err=as_json)
        if value >= facts.modulus:
            refuse(
                f"--value {value} is beyond its range, expected 0 to "
                f"{facts.modulus - 1}"
            )
        if not yes:
            kept = " and store it" if store else ""
            text = f"preset this encoder to {value}{kept}?"
            typer.confirm(text, abort=True, err=as_json)
        position = tool.preset(node, value, store)
    report = {"node": node, "before": facts.position, "after": position}
    text = f"node {node} is at {position}{', stored' if store else ''}"
    print_report(report | {"stored": store}, [text], as_json=as_json)


@contextmanager
def _opened(bus: BusOptions) -> Iterator["Commissioning"]:
    from traverse.drivers.canopen.commissioning import (
        Commissioning,  # an extra; quick help
    )

    where = bus.interface, bus.channel, bus.bitrate, bus.timeout
    with device_errors(), Commissioning(*where) as tool:
        yield tool


def _report(node: "FoundNode") -> dict[str, Any]:
    from traverse.protocol.canopen.frames import STATES

    activity, facts, kind = node.heard, node.facts, node.device_type
    vendor, product, revision, serial = (None,) * 4 if facts is None else facts.identity
    state = (
        None
        if activity.state is None
        else STATES.get(activity.state, str(activity.state))
    )
    return {
        "node": node.node,
        "answers": activity.answers,
        "state": state,
        "profile": None if kind is None else kind & 0xFFFF,
        "kind": None if facts is None else facts.kind,
        "vendor": vendor,
        "product": product,
        "revision": revision,
        "serial": serial,
        "version": None if facts is None else facts.profile,
        **{
            name: getattr(facts, name, None)
            for name in ("counts_per_turn", "modulus", "position", "alarms", "warnings")
        },
        "emergencies": activity.emergencies,
        "problem": node.problem or None,
    }


def _line(node: dict[str, Any]) -> str:
    from traverse.protocol.canopen.objects import alarm_text, warning_text

    text = f"node {node['node']:3d}: "
    if node["problem"]:
        text += node["problem"]
    else:
        turns = node["modulus"] / node["counts_per_turn"]
        text += (
            f"{node['kind']} encoder, {node['counts_per_turn']} counts per turn, "
            f"{counted(turns, 'turn')}, position {node['position']}; vendor "
            f"{_hex(node['vendor'])}"
            f", product {_hex(node['product'])}, serial number {_hex(node['serial'])}"
        )
        if node["alarms"]:
            text += f"; ALARM: {alarm_text(node['alarms'])}"
        if node["warnings"]:
            text += f"; warning: {warning_text(node['warnings'])}"
    if node["answers"] > 1:
        text += f"; {node['answers']} answers to one question: several have this number"
    return text


def _hex(number: int | None) -> str:
    return "unknown" if number is None else f"{number:X}"

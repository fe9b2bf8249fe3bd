"""`traverse gateway keys`: points typed into the program that has the keyboard."""

from collections.abc import Coroutine
from typing import Annotated, Any, Literal

import typer

from traverse.cli.broker_options import BrokerOptions, with_broker
from traverse.cli.gateway.running import report, run, send
from traverse.cli.refusals import refusals


@with_broker
def keys(
    *,
    arm: Annotated[str, typer.Option(help="Name of the arm.")],
    broker: BrokerOptions,
    through: Annotated[
        Literal["desktop", "uinput"], typer.Option(help="What types.")
    ] = "desktop",
    separator: Annotated[
        Literal["tab", "enter", "space", "comma", "semicolon"],
        typer.Option(help="Between x, y and z."),
    ] = "tab",
    after: Annotated[
        Literal["enter", "tab", "space"], typer.Option(help="Key after a point.")
    ] = "enter",
    coordinates: Annotated[
        Literal["centre", "surface", "part"], typer.Option(help="Of x, y and z.")
    ] = "centre",
    unit: Annotated[Literal["mm", "inch"], typer.Option(help="Of x, y and z.")] = "mm",
    decimal: Annotated[Literal[".", ","], typer.Option(help="Decimal sign.")] = ".",
    stop_key: Annotated[
        Literal["f7", "f8", "f9", "f10", "f11", "f12", "pause", "esc"],
        typer.Option(help="Stops typing; pressed again, lets it go on."),
    ] = "f9",
) -> None:
    """Type points into the program that has the keyboard.

    A point in doubt is not typed, nor any while the arm is in alarm or the stop key was
    pressed; none of these is typed later. Ends on Ctrl-C or SIGTERM with a line of
    sums.
    """
    from traverse.client.arm import Arm  # noqa: PLC0415 - keeps --help quick
    from traverse.client.gateways import keys as typing_keys  # noqa: PLC0415
    from traverse.client.gateways.lines import LineForm, LineGateway  # noqa: PLC0415

    with refusals(ValueError):
        typing_keys.check_typable(through, separator)
        form = LineForm(
            typing_keys.keys_template(separator, after),
            None,
            coordinates,
            unit,
            decimal,
            sends_doubtful=False,
        )
    address = broker.address()

    def work() -> Coroutine[Any, Any, None]:
        there = Arm(arm, address)
        outlet = typing_keys.KeysOutlet(there, through, stop_key, report)
        return send(there, "points", LineGateway(form, outlet, report))

    run(lambda: "the keyboard", work)

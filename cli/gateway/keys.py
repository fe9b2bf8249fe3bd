"""`traverse gateway keys`: points typed into the program that has the keyboard."""

from collections.abc import Coroutine
from typing import Any, Literal

from traverse.cli.broker_options import BrokerOptions
from traverse.cli.gateway.running import report, run, send
from traverse.cli.refusals import refusals


def keys(
    *,
    arm: str,
    broker: BrokerOptions,
    through: Literal["desktop", "uinput"] = "desktop",
    separator: Literal["tab", "enter", "space", "comma", "semicolon"] = "tab",
    after: Literal["enter", "tab", "space"] = "enter",
    coordinates: Literal["centre", "surface", "part"] = "centre",
    unit: Literal["mm", "inch"] = "mm",
    decimal: Literal[".", ","] = ".",
    stop_key: Literal["f7", "f8", "f9", "f10", "f11", "f12", "pause", "esc"] = "f9",
) -> None:
    """Type points into the program that has the keyboard.

    A point in doubt is not typed, nor any while the arm is in alarm or the stop key was
    pressed; none of these is typed later. Ends on Ctrl-C or SIGTERM with a line of
    sums.

    Args:
        arm: Name of the arm.
        through: What types.
        separator: Between x, y and z.
        after: Key after a point.
        coordinates: Of x, y and z.
        unit: Of x, y and z.
        decimal: Decimal sign.
        stop_key: Stops typing; pressed again, lets it go on.
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

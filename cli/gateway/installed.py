"""Gateways of other packages: an async function that becomes a command."""

import inspect
from collections.abc import Awaitable, Callable, Collection, Iterator
from typing import TYPE_CHECKING, Any, Literal

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import CommandGroup
from traverse.cli.common.refusals import refuse
from traverse.cli.gateway.running import run, until_signal
from traverse.extensions import (
    GATEWAY_GROUP,
    BrokenExtensionError,
    broken_extension,
    load_extension,
    offered_extensions,
    package_of,
)

if TYPE_CHECKING:
    from traverse.client.arm import Arm

Gateway = Callable[..., Awaitable[None]]


def add_installed(group: CommandGroup, built_in: Collection[str]) -> None:
    """Add the gateways of other packages; one is imported when its command is run."""
    for name, (entry, *_) in offered_extensions(GATEWAY_GROUP).items():
        if name not in built_in:
            typer.Typer.command(
                group,
                name,
                help=f"Of package {package_of(entry)}.",
                # The command that is made on demand reads all of them.
                add_help_option=False,
                context_settings={
                    "allow_extra_args": True,
                    "ignore_unknown_options": True,
                },
            )(_runs_gateway)


def _runs_gateway(ctx: typer.Context) -> None:
    name = str(ctx.info_name)
    try:
        gateway = load_gateway(name)
    except BrokenExtensionError as error:
        refuse(str(error))
    single = CommandGroup(name)
    single.command(name)(_command(name, gateway))
    command = typer.main.get_command(single)
    with command.make_context(name, list(ctx.args), parent=ctx.parent) as context:
        command.invoke(context)


def load_gateway(name: str) -> Gateway:
    """Import a gateway that another package offers.

    It takes the connected arm, then options by their names, and sends until it is
    cancelled.

    Raises:
        KeyError: no package offers it.
        BrokenExtensionError: it cannot be imported, or is no async function.
    """
    gateway = load_extension(GATEWAY_GROUP, name, object)
    if inspect.iscoroutinefunction(gateway):
        return gateway
    entry = offered_extensions(GATEWAY_GROUP)[name][0]
    raise broken_extension(GATEWAY_GROUP, entry, "is no async function")


def _command(name: str, gateway: Gateway) -> Callable[..., None]:
    def command(
        *,
        arm: str,
        broker: BrokerOptions,
        since: Literal["now", "session", "beginning"] = "now",
        **options: object,
    ) -> None:
        from traverse.client.arm import Arm

        client = Arm(arm, broker.address(), since=since)
        run(f"gateway {name}", until_signal(_connected(client, gateway, options)))

    common = list(inspect.signature(command).parameters.values())[:-1]
    command.__signature__ = inspect.Signature([*common, *_options(gateway)])  # type: ignore[attr-defined]  # of PEP 362
    about, _, options_help = (inspect.getdoc(gateway) or "").partition("\n\nArgs:")
    command.__doc__ = (
        f"{about}\n\nArgs:{options_help}\n    arm: Name of the arm.\n"
        "    since: From where on points are sent."
    )
    return command


def _options(gateway: Gateway) -> Iterator[inspect.Parameter]:
    """Yield the parameters of a gateway behind the arm."""
    _arm, *options = inspect.signature(gateway, eval_str=True).parameters.values()
    yield from options


async def _connected(arm: "Arm", gateway: Gateway, options: dict[str, Any]) -> None:
    async with arm:
        await gateway(arm, **options)

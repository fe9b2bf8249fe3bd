"""`traverse watch`: an arm's messages, as a display or line by line."""

import asyncio
import contextlib
import sys
from typing import Annotated

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.common.broker_options import BrokerOptions, arms_at
from traverse.cli.common.refusals import UNREACHABLE

FIND_S = 2.0
DISPLAY_S = 0.1
KINDS = ("status", "point", "scan", "event", "health", "live")


def watch(
    *,
    broker: BrokerOptions,
    arm: str = "+",
    kinds: Annotated[
        str, typer.Option(help=f"What to show, of: {', '.join(KINDS)}.")
    ] = "status,point,scan,event,health",
    as_json: Annotated[bool, typer.Option("--json")] = False,
    lines: bool = False,
) -> None:
    """Follow an arm: a live display, or a line a message.

    The display is of one arm: the one of --arm-name, or the only one on the broker; of
    several there are lines. Reconnects after an outage of the broker. Ends
    on Ctrl-C. Exit status 3: the broker could not be reached at the start.

    Args:
        arm: Name of the arm; + for all.
        as_json: One JSON message a line.
        lines: Lines on a terminal, too.
    """
    shown_kinds = [kind.strip() for kind in kinds.split(",") if kind.strip()]
    unknown = [kind for kind in shown_kinds if kind not in KINDS]
    if unknown or not shown_kinds:
        raise typer.BadParameter(
            f"{', '.join(unknown) or 'nothing'} is none of: {', '.join(KINDS)}",
            param_hint="--kinds",
        )
    address = broker.address()
    try:
        if sys.stdout.isatty() and not (lines or as_json):
            arms = arms_at(address, FIND_S) if arm == "+" else [arm]
            if len(arms) == 1:
                asyncio.run(_display(address, arms[0]))
                return
        asyncio.run(_follow(address, arm, shown_kinds, as_json))
    except KeyboardInterrupt:
        raise typer.Exit(0) from None


async def _display(broker: BrokerAddress, arm: str) -> None:
    from rich.live import Live

    from traverse.cli.watch.view import picture
    from traverse.client.display.follower import Follower, following

    follower = Follower(arm, broker)
    with contextlib.suppress(asyncio.CancelledError):  # Ctrl-C
        async with following(follower):
            with Live(picture(arm, follower.sight), auto_refresh=False) as display:
                while True:
                    await asyncio.sleep(DISPLAY_S)
                    display.update(picture(arm, follower.sight), refresh=True)


async def _follow(
    broker: BrokerAddress, arm: str, kinds: list[str], as_json: bool
) -> None:
    has_messages = asyncio.Event()
    await asyncio.gather(
        _write(broker, arm, kinds, as_json, has_messages),
        _notify_absence(broker, arm, has_messages),
    )


async def _notify_absence(
    broker: BrokerAddress, arm: str, has_messages: asyncio.Event
) -> None:
    from traverse.client.errors import ClientError
    from traverse.client.mqtt.subscription import absence_of

    await asyncio.sleep(FIND_S)
    with contextlib.suppress(ClientError):  # no broker, which is reported elsewhere
        if not has_messages.is_set() and (
            absence := await absence_of(arm, broker, FIND_S)
        ):
            typer.echo(f"{absence}; waiting for it, Ctrl-C ends", err=True)


async def _write(
    broker: BrokerAddress,
    arm: str,
    kinds: list[str],
    as_json: bool,
    has_messages: asyncio.Event,
) -> None:
    from traverse.broker.errors import MqttError
    from traverse.cli.common.message_lines import line
    from traverse.client.mqtt.connection import ConfiguredClient
    from traverse.client.mqtt.subscription import received, subscribe
    from traverse.protocol.encoding import encode

    reached = False
    while True:
        try:
            async with ConfiguredClient(broker) as client:
                reached = True
                await subscribe(client, arm, kinds)
                async for item in received(client):
                    has_messages.set()
                    if item.message is None:
                        typer.echo(f"{item.kind}: {item.error}", err=True)
                    elif as_json:
                        typer.echo(encode(item.message, "json").decode())
                    else:
                        typer.echo(line(item.arm, item.message))
        except BrokenPipeError:
            raise  # the reader of our lines has closed; typer ends silently
        except (MqttError, OSError) as error:
            typer.echo(f"broker {broker}: {error}", err=True)
            if not reached:
                raise typer.Exit(UNREACHABLE) from error
            await asyncio.sleep(1.0)

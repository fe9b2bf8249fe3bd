"""`traverse watch`: what an arm says, line by line."""

import asyncio
from typing import Annotated

import typer

KINDS = ("status", "point", "scan", "event", "health", "live")


def watch(
    broker: Annotated[str, typer.Option(help="Host of the MQTT broker.")] = "localhost",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Its port.")] = 1883,
    arm: Annotated[str, typer.Option(help="Name of the arm; + for all.")] = "+",
    kinds: Annotated[
        str, typer.Option(help=f"What to show, of: {', '.join(KINDS)}.")
    ] = "status,point,scan,event,health",
    as_json: Annotated[
        bool, typer.Option("--json", help="One JSON message a line.")
    ] = False,
) -> None:
    """Follow an arm: points, scans, events and health as they come.

    Comes back by itself when the broker has been away. Ends on Ctrl-C. Exit status 3:
    the broker could not be reached at the start.
    """
    wanted = [kind.strip() for kind in kinds.split(",") if kind.strip()]
    unknown = [kind for kind in wanted if kind not in KINDS]
    if unknown or not wanted:
        raise typer.BadParameter(
            f"{', '.join(unknown) or 'nothing'} is none of: {', '.join(KINDS)}",
            param_hint="--kinds",
        )
    try:
        asyncio.run(_follow(broker, port, arm, wanted, as_json))
    except KeyboardInterrupt:
        raise typer.Exit(0) from None


async def _follow(
    broker: str, port: int, arm: str, kinds: list[str], as_json: bool
) -> None:
    import aiomqtt  # noqa: PLC0415 - keeps --help quick

    from clients.subscription import connection, received, subscribe  # noqa: PLC0415
    from protocol.encoding import encode  # noqa: PLC0415
    from traverse.lines import line  # noqa: PLC0415

    reached = False
    while True:
        try:
            async with connection(broker, port) as client:
                reached = True
                await subscribe(client, arm, kinds)
                async for item in received(client):
                    if item.message is None:
                        typer.echo(f"{item.kind}: {item.error}", err=True)
                    elif as_json:
                        typer.echo(encode(item.message, "json").decode())
                    else:
                        typer.echo(line(item.arm, item.message))
        except BrokenPipeError:
            raise  # nobody reads our lines any more; typer ends without a word
        except (aiomqtt.MqttError, OSError) as error:
            typer.echo(f"broker {broker}:{port}: {error}", err=True)
            if not reached:
                raise typer.Exit(3) from error
            await asyncio.sleep(1.0)

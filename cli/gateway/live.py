"""`traverse gateway live`: an arm in a viewer that speaks Foxglove's protocol."""

from collections.abc import Coroutine
from typing import Annotated, Any, Literal

import typer

from traverse.cli.broker_options import BrokerOptions
from traverse.cli.gateway.running import host_port, report, run, until_signal
from traverse.cli.refusals import refusals
from traverse.plurals import counted


def live(
    *,
    arm: str,
    broker: BrokerOptions,
    listen: str = "8765",
    magnify: Annotated[float, typer.Option(min=1.0, max=1e6)] = 1.0,
    since: Literal["now", "session", "beginning"] = "session",
) -> None:
    """Show the arm, its points, scans and state in Foxglove, while it measures.

    Ends on Ctrl-C or SIGTERM.

    Args:
        arm: Name of the arm.
        listen: PORT on this machine, or HOST:PORT.
        magnify: Ellipsoids are so many times as large.
        since: From where on points are shown.
    """
    from traverse.client.arm import Arm  # noqa: PLC0415 - keeps --help quick
    from traverse.client.gateways.live import LiveServer  # noqa: PLC0415

    with refusals(ValueError):
        host, port = host_port(listen, "--listen", "127.0.0.1")
    address = broker.address()

    def work() -> Coroutine[Any, Any, None]:
        there = Arm(arm, address, since=since)
        server = LiveServer(there, host, port, magnify, report)

        async def serve() -> None:
            async with server, there:
                where = f"{arm} at {server.address}"
                report(f"{where}: open it in Foxglove as a connection")
                await until_signal(server.serve())
            report(f"{counted(server.points, 'point')} shown")

        return serve()

    run(lambda: f"ws://{host}:{port}", work)

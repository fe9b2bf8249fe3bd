"""`traverse gateway ippdme`: an arm for metrology software that speaks I++ DME."""

from collections.abc import Coroutine
from pathlib import Path
from typing import Annotated, Any

import typer

from traverse.cli.broker_options import BrokerOptions, with_broker
from traverse.cli.gateway.running import host_port, report, run, until_signal
from traverse.cli.refusals import refusals


@with_broker
def ippdme(
    *,
    arm: Annotated[str, typer.Option(help="Name of the arm.")],
    broker: BrokerOptions,
    listen: Annotated[
        str, typer.Option(help="PORT on this machine, or HOST:PORT.")
    ] = "1294",
    near_mm: Annotated[
        float,
        typer.Option(
            "--near", min=0.0, help="So far from its target a PtMeas may be [mm]."
        ),
    ] = 10.0,
    probes: Annotated[
        Path | None,
        typer.Option(help="Probe library, for the radii of tools that are not active."),
    ] = None,
    key: Annotated[
        list[str] | None,
        typer.Option(
            help="INPUT=NAME: button as KeyPress, as base/1=Done. Repeatable."
        ),
    ] = None,
    quote_class: Annotated[
        bool,
        typer.Option("--quote-class", help="GetMachineClass answers in quotes."),
    ] = False,
) -> None:
    """Serve the arm to a client of I++ DME 1.4.3, one at a time.

    What happens is reported on standard error. Ends on Ctrl-C or SIGTERM.
    """
    from traverse.client.arm import Arm  # noqa: PLC0415 - keeps --help quick
    from traverse.client.gateways.ippdme.server import IppServer  # noqa: PLC0415
    from traverse.client.gateways.ippdme.session import Options  # noqa: PLC0415
    from traverse.daemon.pose.probe_library import read_probes  # noqa: PLC0415

    with refusals(ValueError):
        host, port = host_port(listen, "--listen", "127.0.0.1")
        keys = dict(_key(text) for text in key or ())
        library = () if probes is None else read_probes(probes).probes
    options = Options(
        near_mm,
        {probe.name: probe.radius_mm for probe in library},
        keys,
        '"CartCMM"' if quote_class else "CartCMM",
    )
    address = broker.address()

    def work() -> Coroutine[Any, Any, None]:
        there = Arm(arm, address)
        server = IppServer(there, host, port, report, options)

        async def serve() -> None:
            async with there:
                await server.serve(
                    lambda: report(f"I++ DME server of {arm} on {server.address}")
                )

        return until_signal(serve())

    run(lambda: f"tcp {host}:{port}", work)


def _key(text: str) -> tuple[str, str]:
    source, _, name = text.partition("=")
    if not (source and name.isascii() and name.isalnum()):
        raise ValueError(f"--key {text}: expected INPUT=NAME, such as base/1=Done")
    return source, name

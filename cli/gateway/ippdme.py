"""`traverse gateway ippdme`: an arm for metrology software that speaks I++ DME."""

from collections.abc import Coroutine
from pathlib import Path
from typing import Annotated, Any

import typer

from traverse.cli.broker_options import BrokerOptions
from traverse.cli.gateway.running import host_port, report, run, until_signal
from traverse.cli.refusals import refusals


def ippdme(
    *,
    arm: str,
    broker: BrokerOptions,
    listen: str = "1294",
    near_mm: Annotated[float, typer.Option("--near", min=0.0)] = 10.0,
    probes: Path | None = None,
    key: list[str] | None = None,
    quote_class: bool = False,
) -> None:
    """Serve the arm to a client of I++ DME 1.4.3, one at a time.

    What happens is reported on standard error. Ends on Ctrl-C or SIGTERM.

    Args:
        arm: Name of the arm.
        listen: PORT on this machine, or HOST:PORT.
        near_mm: So far from its target a PtMeas may be [mm].
        probes: Probe library, for the radii of tools that are not active.
        key: INPUT=NAME: a button as KeyPress, as base/1=Done. Repeatable.
        quote_class: GetMachineClass answers in quotes.
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

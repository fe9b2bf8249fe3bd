"""`traverse run`: the daemon."""

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from traverse.logs import log_to_stderr


def run(
    config: Annotated[
        Path, typer.Option("--config", "-c", help="The daemon's configuration, TOML.")
    ],
    embedded_broker: Annotated[
        bool,
        typer.Option(
            "--embedded-broker",
            help="Bring an own MQTT broker on loopback (extra `demo`).",
        ),
    ] = False,
    embedded_port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the embedded broker; 0 takes a free one."
        ),
    ] = 1883,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log more.")] = False,
) -> None:
    """Measure: read the arm's encoders and publish points over MQTT.

    Ends in order on SIGTERM or Ctrl-C. Exit status 2: the configuration or arm file was
    refused; 3: a device or the broker could not be reached.
    """
    from daemon.program import run_service  # noqa: PLC0415 - keeps --help quick

    log_to_stderr(verbose=verbose)
    status = asyncio.run(
        run_service(config, embedded=embedded_broker, embedded_port=embedded_port)
    )
    raise typer.Exit(status)

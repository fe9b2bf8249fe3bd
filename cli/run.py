"""`traverse run`: the daemon."""

import asyncio
import gc
from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.refusals import RefusalError
from traverse.daemon.system.log_setup import LogFormat, LogLevel, start_log
from traverse.daemon.system.open_files import ensure_open_files


def run(
    config: Path,
    *,
    embedded_broker: bool = False,
    embedded_port: Annotated[int, typer.Option(min=0, max=65535)] = 1883,
    keep_trying: bool = False,
    log_format: LogFormat = "auto",
    log_level: LogLevel = "info",
) -> None:
    """Measure: read the encoders, publish points over MQTT.

    Ends in order on SIGTERM or Ctrl-C. Exit status 2: the configuration or arm file was
    refused; 3: a device or the broker could not be reached, a file that the
    configuration names is not there, or the state folder is in use or unusable.

    Args:
        config: The daemon's configuration, TOML.
        embedded_broker: Start an own MQTT broker on loopback (extra `demo`).
        embedded_port: Port of the embedded broker; 0: a free one, logged.
        keep_trying: Start also without a device or broker that cannot be reached,
            report it, and keep trying; for a service.
        log_format: How the log is written; auto: to the journal under systemd, else
            plain lines.
        log_level: Lowest level that is logged.
    """
    gc.disable()  # until `freeze_objects`; what a start makes stays
    try:
        ensure_open_files()
    except ValueError as error:
        raise RefusalError(str(error)) from error
    from traverse.daemon.app import run_service

    start_log(log_format, log_level)
    status = asyncio.run(
        run_service(
            config,
            embedded=embedded_broker,
            embedded_port=embedded_port,
            keep_trying=keep_trying,
        )
    )
    raise typer.Exit(status)

"""`traverse gateway`: points for programs that do not speak MQTT."""

import asyncio
import sqlite3
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from traverse.cli.broker_options import BrokerOptions, with_broker
from traverse.cli.gateway.ippdme import ippdme
from traverse.cli.gateway.keys import keys
from traverse.cli.gateway.live import live
from traverse.cli.gateway.running import (
    Kind,
    host_port,
    report,
    run,
    send,
    until_signal,
)
from traverse.cli.refusals import client_errors, refusals, refuse

if TYPE_CHECKING:
    from traverse.client.gateways.outlets import Outlet

gateway = typer.Typer(
    help="Points for programs that do not speak MQTT.", no_args_is_help=True
)
gateway.command("ippdme")(ippdme)
gateway.command("keys")(keys)
gateway.command("live")(live)


@gateway.command("lines")
@with_broker
def lines(
    *,
    arm: Annotated[str, typer.Option(help="Name of the arm.")],
    broker: BrokerOptions,
    tcp: Annotated[
        str | None,
        typer.Option(help="Serve who connects: PORT on this machine, or HOST:PORT."),
    ] = None,
    udp: Annotated[
        str | None, typer.Option(help="A datagram a line to HOST:PORT.")
    ] = None,
    serial: Annotated[
        str | None, typer.Option(help="Write to this serial port.")
    ] = None,
    baud: Annotated[int, typer.Option(min=50, help="Of the serial port [baud].")] = (
        9600
    ),
    file: Annotated[Path | None, typer.Option(help="Append to this file.")] = None,
    template: Annotated[
        str,
        typer.Option(help="pcdmis, linuxcnc, spreadsheet, or a text with {names}."),
    ] = "pcdmis",
    undo: Annotated[
        str | None, typer.Option(help="Template for points taken back; else none.")
    ] = None,
    kind: Annotated[Kind, typer.Option(help="What is sent.")] = "points",
    coordinates: Annotated[
        Literal["centre", "surface", "part"], typer.Option(help="Of x, y and z.")
    ] = "centre",
    unit: Annotated[Literal["mm", "inch"], typer.Option(help="Of x, y and z.")] = "mm",
    decimal: Annotated[Literal[".", ","], typer.Option(help="Decimal sign.")] = ".",
    send_doubtful: Annotated[
        bool,
        typer.Option(
            "--send-doubtful",
            help="Send points in doubt even where their line does not say so.",
        ),
    ] = False,
    since: Annotated[
        Literal["now", "session", "beginning"],
        typer.Option(help="Where points begin without a cursor."),
    ] = "now",
    cursor_file: Annotated[
        Path | None,
        typer.Option(help="File that keeps the place over restarts."),
    ] = None,
) -> None:
    """Send points as lines of text: over TCP or UDP, to a serial port or into a file.

    While nothing takes lines, points wait at the arm. What is not sent, and why, is
    reported on standard error. Ends on Ctrl-C or SIGTERM with a line of sums.
    """
    from traverse.client.arm import Arm  # noqa: PLC0415 - keeps --help quick
    from traverse.client.gateways.lines import LineForm, LineGateway  # noqa: PLC0415

    with refusals(ValueError):
        form = LineForm(
            template,
            undo,
            coordinates,
            unit,
            decimal,
            sends_doubtful=send_doubtful,
        )
        if kind == "scans" and coordinates == "surface":
            raise ValueError("--kind scans has no --coordinates surface")
        outlet = _outlet(tcp, udp, serial, baud, file)
    address = broker.address()

    def work() -> Coroutine[Any, Any, None]:
        there = Arm(arm, address, since=since, cursor_file=cursor_file)
        return send(there, kind, LineGateway(form, outlet, report))

    run(lambda: outlet.name, work)


@gateway.command("home-assistant")
@with_broker
def home_assistant(
    *,
    arm: Annotated[str, typer.Option(help="Name of the arm.")],
    broker: BrokerOptions,
    prefix: Annotated[
        str, typer.Option(help="Topic of Home Assistant's discovery.")
    ] = "homeassistant",
    history: Annotated[
        Path | None,
        typer.Option(help="File of daily checks, interim.db: shows the last one."),
    ] = None,
    remove: Annotated[
        bool, typer.Option("--remove", help="Take the arm out again, and end.")
    ] = False,
) -> None:
    """Show an arm's state in Home Assistant, by MQTT discovery.

    Ends on Ctrl-C or SIGTERM; the arm is then shown as unavailable.
    """
    from traverse.client.gateways.home_assistant import HomeAssistantGateway  # noqa: PLC0415 - keeps --help quick
    from traverse.lab.daily_check.history import HistoryRefusedError, checks_of  # noqa: PLC0415
    from traverse.protocol.message_error import MessageError  # noqa: PLC0415
    from traverse.protocol.topics import status_topic  # noqa: PLC0415

    with refusals(MessageError):
        status_topic(arm)
    if not prefix or any(sign in prefix for sign in "+#\0"):
        refuse(f"--prefix {prefix}: expected a topic, without + and #")
    if history is not None and not history.is_file():
        refuse(f"--history {history}: there is no such file")

    def last_check() -> str | None:
        checks = checks_of(history, arm) if history and history.is_file() else []
        return checks[-1].time_utc if checks else None

    address = broker.address()
    with refusals(HistoryRefusedError, sqlite3.Error), client_errors():
        last_check()  # whether it can be read is said at once
        shown = HomeAssistantGateway(arm, address, prefix, report, last_check)
        asyncio.run(shown.remove() if remove else until_signal(shown.run()))


def _outlet(
    tcp: str | None, udp: str | None, serial: str | None, baud: int, file: Path | None
) -> "Outlet":
    """The one that is named; raises ValueError."""
    from traverse.client.gateways import outlets  # noqa: PLC0415
    from traverse.client.gateways.tcp_outlet import TcpOutlet  # noqa: PLC0415

    if sum(one is not None for one in (tcp, udp, serial, file)) != 1:
        raise ValueError("give one of --tcp, --udp, --serial and --file")
    if tcp is not None:
        return TcpOutlet(*host_port(tcp, "--tcp", "127.0.0.1"), report)
    if udp is not None:
        return outlets.UdpOutlet(*host_port(udp, "--udp", None), report)
    if serial is not None:
        return outlets.SerialOutlet(serial, baud, report)
    path = file or Path()
    if path.is_dir() or not path.parent.is_dir():
        raise ValueError(f"--file {path}: name a file in a folder that is there")
    return outlets.FileOutlet(path, report)

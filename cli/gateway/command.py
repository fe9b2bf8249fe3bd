"""`traverse gateway`: points for programs that do not speak MQTT."""

import asyncio
import sqlite3
from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from traverse.cli.broker_options import BrokerOptions
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
from traverse.cli.options import CommandGroup
from traverse.cli.refusals import client_errors, refusals, refuse

if TYPE_CHECKING:
    from traverse.client.gateways.outlets import Outlet

gateway = CommandGroup(
    help="Points for programs that do not speak MQTT.", no_args_is_help=True
)
gateway.command("ippdme")(ippdme)
gateway.command("keys")(keys)
gateway.command("live")(live)


@gateway.command("lines")
def lines(
    *,
    arm: str,
    broker: BrokerOptions,
    tcp: str | None = None,
    udp: str | None = None,
    serial: str | None = None,
    baud: Annotated[int, typer.Option(min=50)] = 9600,
    file: Path | None = None,
    template: str = "pcdmis",
    undo: str | None = None,
    kind: Kind = "points",
    coordinates: Literal["centre", "surface", "part"] = "centre",
    unit: Literal["mm", "inch"] = "mm",
    decimal: Literal[".", ","] = ".",
    send_doubtful: bool = False,
    since: Literal["now", "session", "beginning"] = "now",
    cursor_file: Path | None = None,
) -> None:
    """Send points as lines of text: over TCP or UDP, to a serial port or into a file.

    While nothing takes lines, points wait at the arm. What is not sent, and why, is
    reported on standard error. Ends on Ctrl-C or SIGTERM with a line of sums.

    Args:
        arm: Name of the arm.
        tcp: Serve who connects: PORT on this machine, or HOST:PORT.
        udp: A datagram a line to HOST:PORT.
        serial: Write to this serial port.
        baud: Of the serial port [baud].
        file: Append to this file.
        template: pcdmis, linuxcnc, spreadsheet, or a text with {names}.
        undo: Template for points taken back; else none.
        kind: What is sent.
        coordinates: Of x, y and z.
        unit: Of x, y and z.
        decimal: Decimal sign.
        send_doubtful: Send points in doubt even where their line does not say so.
        since: Where points begin without a cursor.
        cursor_file: File that keeps the place over restarts.
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
def home_assistant(
    *,
    arm: str,
    broker: BrokerOptions,
    prefix: str = "homeassistant",
    history: Path | None = None,
    remove: bool = False,
) -> None:
    """Show an arm's state in Home Assistant, by MQTT discovery.

    Ends on Ctrl-C or SIGTERM; the arm is then shown as unavailable.

    Args:
        arm: Name of the arm.
        prefix: Topic of Home Assistant's discovery.
        history: File of daily checks, interim.db: shows the last one.
        remove: Take the arm out again, and end.
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

"""`traverse gateway`: points for programs that do not speak MQTT."""

import asyncio
import sqlite3
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from traverse.cli.common.broker_options import BrokerOptions
from traverse.cli.common.options import CommandGroup
from traverse.cli.common.refusals import client_errors, refusals, refuse
from traverse.cli.gateway.installed import add_installed
from traverse.cli.gateway.running import (
    Kind,
    host_port,
    report,
    run,
    send,
    serve,
    until_signal,
)

if TYPE_CHECKING:
    from traverse.client.gateways.outlets import Outlet

gateway = CommandGroup("gateway", help="Points for programs that do not speak MQTT.")


@gateway.command("ippdme")
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
        key: INPUT=NAME: button as KeyPress, as base/1=Done. Repeatable.
        quote_class: GetMachineClass answers in quotes.
    """
    from traverse.client.arm import Arm
    from traverse.client.gateways.ippdme.options import Options
    from traverse.client.gateways.ippdme.server import IppServer
    from traverse.daemon.pose.probe_library import read_probes

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

    async def work() -> None:
        client = Arm(arm, address)
        server = IppServer(client, host, port, report, options)
        async with client:
            await server.serve(
                lambda: report(f"I++ DME server of {arm} on {server.address}")
            )

    run(f"tcp {host}:{port}", until_signal(work()))


@gateway.command("keys")
def keys(
    *,
    arm: str,
    broker: BrokerOptions,
    through: Literal["desktop", "uinput"] = "desktop",
    separator: Literal["tab", "enter", "space", "comma", "semicolon"] = "tab",
    after: Literal["enter", "tab", "space"] = "enter",
    coordinates: Literal["centre", "surface", "part"] = "centre",
    unit: Literal["mm", "inch"] = "mm",
    decimal: Literal[".", ","] = ".",
    stop_key: Literal["f7", "f8", "f9", "f10", "f11", "f12", "pause", "esc"] = "f9",
) -> None:
    """Type points into the program that has the keyboard.

    A point in doubt is not typed, nor any while the arm is in alarm or the stop key was
    pressed; none of these is typed later. Ends on Ctrl-C or SIGTERM with a line of
    sums.

    Args:
        arm: Name of the arm.
        through: What types.
        separator: Between x, y and z.
        after: Key after a point.
        coordinates: Of x, y and z.
        unit: Of x, y and z.
        decimal: Decimal sign.
        stop_key: Stops typing; pressed again, lets it go on.
    """
    from traverse.client.arm import Arm
    from traverse.client.gateways import keys as typing_keys
    from traverse.client.gateways.lines import LineForm, LineGateway

    with refusals(ValueError):
        typing_keys.check_typable(through, separator)
        form = LineForm(
            typing_keys.keys_template(separator, after),
            None,
            coordinates,
            unit,
            decimal,
            sends_doubtful=False,
        )
    address = broker.address()

    async def work() -> None:
        client = Arm(arm, address)
        outlet = typing_keys.KeysOutlet(client, through, stop_key, report)
        await send(client, "points", LineGateway(form, outlet, report))

    run("the keyboard", work())


@gateway.command("live")
def live(
    *,
    arm: str,
    broker: BrokerOptions,
    listen: str = "8765",
    magnify: Annotated[float, typer.Option(min=1.0, max=1e6)] = 1.0,
    since: Literal["now", "session", "beginning"] = "session",
    arm_file: Path | None = None,
) -> None:
    """Show the arm, its points, scans and state in Foxglove, while it measures.

    Ends on Ctrl-C or SIGTERM.

    Args:
        arm: Name of the arm.
        listen: PORT on this machine, or HOST:PORT.
        magnify: Ellipsoids are so many times as large.
        since: From where on points are shown.
        arm_file: The arm's file: viewers get its robot description and its joints'
            names.
    """
    from traverse.client.arm import Arm
    from traverse.client.gateways.live import LiveServer

    with refusals(ValueError):
        host, port = host_port(listen, "--listen", "127.0.0.1")
        joints, urdf = _described(arm_file)
    address = broker.address()

    async def work() -> None:
        client = Arm(arm, address, since=since)
        server = LiveServer(
            client, host, port, magnify, report, joints=joints, urdf=urdf
        )
        await serve(client, server, "open it in Foxglove as a connection")

    run(f"ws://{host}:{port}", work())


@gateway.command("opcua")
def opcua(
    *,
    arm: str,
    broker: BrokerOptions,
    listen: str = "4840",
    since: Literal["now", "session", "beginning"] = "now",
) -> None:
    """Serve state, pose and points to OPC UA clients, which read only.

    Ends on Ctrl-C or SIGTERM.

    Args:
        arm: Name of the arm.
        listen: PORT on this machine, or HOST:PORT.
        since: From where on points are events.
    """
    from traverse.client.arm import Arm
    from traverse.client.gateways.opcua import OpcUaServer

    with refusals(ValueError):
        host, port = host_port(listen, "--listen", "127.0.0.1")
    address = broker.address()

    async def work() -> None:
        client = Arm(arm, address, since=since)
        server = OpcUaServer(client, host, port, report)
        await serve(client, server, "for clients of OPC UA")

    run(f"tcp {host}:{port}", work())


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
        template: pcdmis, linuxcnc, spreadsheet, mtconnect, or a text with {names}.
        undo: Template for points taken back; else none.
        kind: What is sent.
        coordinates: Of x, y and z.
        unit: Of x, y and z.
        decimal: Decimal sign.
        send_doubtful: Send points in doubt even where their line does not say so.
        since: Where points begin without a cursor.
        cursor_file: File that keeps the place over restarts.
    """
    from traverse.client.arm import Arm
    from traverse.client.gateways.lines import LineForm, LineGateway

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

    async def work() -> None:
        client = Arm(arm, address, since=since, cursor_file=cursor_file)
        await send(client, kind, LineGateway(form, outlet, report))

    run(outlet.name, work())


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
    from traverse.client.gateways.home_assistant import HomeAssistantGateway
    from traverse.lab.daily_check.history import HistoryRefusedError, checks_of
    from traverse.protocol.message_error import MessageError
    from traverse.protocol.topics import status_topic

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


BUILT_IN = tuple(command.name or "" for command in gateway.registered_commands)
add_installed(gateway, BUILT_IN)


def _outlet(
    tcp: str | None, udp: str | None, serial: str | None, baud: int, file: Path | None
) -> "Outlet":
    """Return the outlet that is named; raises ValueError."""
    from traverse.client.gateways import outlets

    if sum(outlet is not None for outlet in (tcp, udp, serial, file)) != 1:
        raise ValueError("give one of --tcp, --udp, --serial and --file")
    if tcp is not None:
        return outlets.TcpOutlet(*host_port(tcp, "--tcp", "127.0.0.1"), report)
    if udp is not None:
        return outlets.UdpOutlet(*host_port(udp, "--udp", None), report)
    if serial is not None:
        return outlets.SerialOutlet(serial, baud, report)
    path = file or Path()
    if path.is_dir() or not path.parent.is_dir():
        raise ValueError(f"--file {path}: name a file in a folder that is there")
    return outlets.FileOutlet(path, report)


def _key(text: str) -> tuple[str, str]:
    source, _, name = text.partition("=")
    if not (source and name.isascii() and name.isalnum()):
        raise ValueError(f"--key {text}: expected INPUT=NAME, such as base/1=Done")
    return source, name


def _described(arm_file: Path | None) -> tuple[list[str], str]:
    """Names of the joints of an arm file, and its robot description."""
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.kinematics.importers.urdf_report import urdf_report

    if arm_file is None:
        return [], ""
    values = read_arm(arm_file)
    _, urdf = urdf_report(values, postures=1, seed=0)
    return [joint.name for joint in values.joints], urdf

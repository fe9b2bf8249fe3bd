"""`traverse demo`: a whole measuring arm on this machine, nothing to configure.

Starts the simulated arm and the daemon as programs of their own, follows them over
MQTT like any client, and judges the points against the certificates.
"""

import asyncio
import contextlib
import signal
import socket
import sys
import tempfile
from collections.abc import AsyncIterator
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.broker.address import BrokerAddress
from traverse.cli.common.refusals import UNREACHABLE, end
from traverse.installation import missing

if TYPE_CHECKING:
    from traverse.broker.client import MqttClient
    from traverse.cli.demo_round import Round

READY_S = 30.0
PAGE_PORT = 8080
STOP_S = 10.0
INTERRUPTED = 130
ARM = "demo-7"


class DemoError(Exception):
    """The demonstration cannot continue, with the reason."""


def demo(
    *,
    once: bool = False,
    for_s: Annotated[float | None, typer.Option("--for", min=1.0)] = None,
    broker: str | None = None,
    rate_hz: Annotated[float, typer.Option("--rate", min=1.0, max=10_000.0)] = 1000.0,
    page: bool = True,
) -> None:
    """Watch a simulated arm measure a bar, a sphere and a cone.

    Prints the points as they arrive, then length, form and spread beside the
    certificates; without --once the operator's page shows the arm in a browser. Ends
    on Ctrl-C, after --for seconds, or after one round with --once.
    Exit status 3: a program did not start, or the daemon ended.

    Args:
        once: End after one round, half a minute.
        for_s: End after so many seconds.
        broker: Existing broker, host or host:port; else one is started.
        rate_hz: Rate of the scan in Hz.
        page: Open the page, if its extra is installed; not with --once.
    """
    try:
        _look_for_extra(with_broker=broker is None)
        with_page = page and not once and find_spec("nicegui") is not None
        asyncio.run(_demonstrate(once, for_s, broker, rate_hz, with_page=with_page))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--broker") from error
    except DemoError as error:
        end(UNREACHABLE, str(error))
    except asyncio.CancelledError as error:
        raise typer.Exit(INTERRUPTED) from error


def _look_for_extra(*, with_broker: bool) -> None:
    """Name missing packages before anything is started."""
    for library in ("serial", "cobs", "mcap", *(("amqtt",) if with_broker else ())):
        if find_spec(library) is None:
            raise DemoError(missing("traverse demo", library, "demo"))


async def _demonstrate(
    once: bool,
    for_s: float | None,
    broker: str | None,
    rate_hz: float,
    *,
    with_page: bool,
) -> None:
    from traverse.cli.demo_round import Round, write_files
    from traverse.client.cancel_tasks import run_until_first
    from traverse.daemon.mqtt.embedded_broker import HOST, free_port

    # A terminal that is closed and `kill` end it as Ctrl-C does: else its programs,
    # which have sessions of their own, would go on.
    task, loop = asyncio.current_task(), asyncio.get_running_loop()
    if task is not None:
        for number in (signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, task.cancel)
    port = free_port()
    broker_options = (
        [] if broker else ["--embedded-broker", "--embedded-port", str(port)]
    )
    address = BrokerAddress.parse(broker) if broker else BrokerAddress(HOST, port)
    measured = Round()
    with tempfile.TemporaryDirectory(prefix="traverse-demo-") as name:
        folder = Path(name)
        write_files(folder, address.host, address.tcp_port)
        async with contextlib.AsyncExitStack() as programs:

            async def start(log: str, *words: str) -> asyncio.subprocess.Process:
                program = _program(folder / log, *words)
                return await programs.enter_async_context(program)

            simulated = ("simulate", "devices", str(folder / "simulator.toml"))
            await _be_ready(await start("simulator.log", *simulated), folder)
            daemon = ("run", str(folder / "daemon.toml"), *broker_options)
            service = await start("daemon.log", *daemon)
            if with_page:
                shown = PAGE_PORT if _is_free(PAGE_PORT) else free_port()
                where = ("--arm-name", ARM, "--broker", str(address))
                await start("page.log", "page", *where, "--port", str(shown))
                typer.echo(f"The operator's page: http://127.0.0.1:{shown}")
            # Ctrl-C: what was measured is still worth telling.
            with contextlib.suppress(TimeoutError, asyncio.CancelledError):
                async with asyncio.timeout(for_s):
                    await run_until_first(
                        _follow(address, measured, once, rate_hz),
                        _fail_with(service, folder),
                    )
    typer.echo("")
    for text in measured.summary():
        typer.echo(text)


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) != 0


@contextlib.asynccontextmanager
async def _program(
    log: Path, *arguments: str
) -> AsyncIterator[asyncio.subprocess.Process]:
    """Run a command of this program beside us; it ends with the block."""
    with log.open("wb") as errors:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "traverse", *arguments),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=errors,
            start_new_session=True,  # Ctrl-C is ours to pass on
        )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(STOP_S):
                await process.communicate()
        except TimeoutError:
            process.kill()
            await process.communicate()


async def _fail_with(daemon: asyncio.subprocess.Process, folder: Path) -> None:
    """Raise when the daemon ends, which nobody requested."""
    await daemon.wait()
    raise DemoError(f"the daemon ended:\n{_said_in(folder / 'daemon.log')}")


async def _be_ready(simulator: asyncio.subprocess.Process, folder: Path) -> None:
    line = b""
    if simulator.stdout is not None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(READY_S):
                line = await simulator.stdout.readline()
    if not line.startswith(b"ready"):
        simulator_log = _said_in(folder / "simulator.log")
        raise DemoError(f"the simulated arm did not start:\n{simulator_log}")


def _said_in(log: Path) -> str:
    return log.read_text("utf-8", "replace")


async def _follow(
    broker: BrokerAddress, measured: "Round", once: bool, rate_hz: float
) -> None:
    """Print and note the arm's messages, until a round is complete."""
    from traverse.cli.common.message_lines import line
    from traverse.client.mqtt.subscription import received, subscribe
    from traverse.protocol.encoding import encode
    from traverse.protocol.messages import (
        Command,
        Event,
        Point,
        ReferenceArgs,
        Scan,
        ScanArgs,
        Status,
    )
    from traverse.protocol.topics import command_topic

    async with _patient_connection(broker) as client:
        await subscribe(client, ARM, ("point", "scan", "event", "status"))
        # The arm rests at a place that its operator knows: confirmed, then scanned.
        first_acts = (
            ReferenceArgs(action="confirm"),
            ScanArgs(action="start", rate_hz=rate_hz),
        )
        has_begun = is_ready = False
        async for item in received(client):
            message = item.message
            if isinstance(message, Point):
                on = measured.add_point(message, item.received_ns)
                target = f"{on.artefact} {on.feature}".strip()
                typer.echo(f"{line(item.arm, message)}   {target}")
                if once and measured.rounds:
                    return
            elif isinstance(message, Scan):
                measured.add_scan(message)
            elif isinstance(message, Event):
                if message.severity != "info" or message.code == "reference.confirmed":
                    typer.echo(line(item.arm, message))
            elif isinstance(message, Status) and not has_begun:
                has_begun = True
                typer.echo("the operator confirms device and reference of the arm")
                for act in first_acts:
                    command = Command.carrying(act, request=f"demo-{act.command}")
                    topic = command_topic(ARM, act.command)
                    await client.publish(topic, encode(command, "msgpack"), qos=1)
            if (
                isinstance(message, Status)
                and message.state == "ready"
                and not is_ready
            ):
                is_ready = True
                typer.echo("every condition is established: numbers are ok")


@contextlib.asynccontextmanager
async def _patient_connection(
    broker: BrokerAddress,
) -> "AsyncIterator[MqttClient]":
    """A connection to a broker that may still be starting."""
    from traverse.broker.errors import MqttError
    from traverse.client.mqtt.connection import ConfiguredClient

    loop = asyncio.get_running_loop()
    until = loop.time() + READY_S
    async with contextlib.AsyncExitStack() as stack:
        while True:
            try:
                client = await stack.enter_async_context(ConfiguredClient(broker))
                break
            except (MqttError, OSError) as error:
                if loop.time() > until:
                    raise DemoError(f"broker {broker}: {error}") from error
                await asyncio.sleep(0.1)
        yield client

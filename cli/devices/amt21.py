"""`traverse amt21`: encoders on an RS-485 line, looked for and set up by hand."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from traverse.cli.common.options import CommandGroup, Json, Yes
from traverse.cli.common.refusals import device_errors, print_report, refuse
from traverse.plurals import counted
from traverse.protocol import amt21 as wire

if TYPE_CHECKING:
    from traverse.drivers.amt21.line import Amt21Line

ADDRESSES = range(4, 253, 4)
TRIES = 3  # for each address of a scan

amt21 = CommandGroup(
    "amt21",
    help="AMT21 encoders on an RS-485 line: scan, zero, reset. "
    "The daemon must not be using the port.",
)

Address = Annotated[
    str, typer.Option("--address", help="Address of the encoder, as 0x54 or 84.")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class LineOptions:
    """Which line, in the order of `--help`.

    Attributes:
        port: Serial port of the adapter.
        baud_rate: Baud rate of the line.
        timeout: Time limit of a reply in seconds.
    """

    port: str
    baud_rate: Annotated[int, typer.Option(min=9600, max=2_000_000)] = 2_000_000
    timeout: Annotated[float, typer.Option(min=0.001, max=1.0)] = 0.01

    @contextmanager
    def opened(self) -> Iterator["Amt21Line"]:
        from traverse.drivers.amt21.line import Amt21Line
        from traverse.drivers.io.serial_port import SerialPort

        wake_read, wake_write = os.pipe2(os.O_NONBLOCK)
        try:
            with (
                device_errors(),
                closing(SerialPort(self.port, self.baud_rate, wake_read)) as serial,
            ):
                yield Amt21Line(serial, time.monotonic_ns, self.timeout)
        finally:
            os.close(wake_read)
            os.close(wake_write)


@amt21.command()
def scan(*, line: LineOptions, as_json: Json = False) -> None:
    """List the addresses that answer, with position and, where they have it, turns."""
    with line.opened() as opened:
        answering = _answering(opened, ADDRESSES)
    lines = []
    for encoder in answering:
        turns = "" if encoder["turns"] is None else f", turns {encoder['turns']}"
        lines.append(
            f"0x{encoder['address']:02X}: position {encoder['position']}{turns}"
        )
    echo = "echoes what is sent" if opened.echoed else "does not echo"
    lines.append(f"{counted(len(answering), 'encoder')}; the adapter {echo}")
    report = {"port": line.port, "echo": opened.echoed, "encoders": answering}
    print_report(report, lines, as_json=as_json)


@amt21.command()
def zero(
    *, line: LineOptions, address: Address, yes: Yes = False, as_json: Json = False
) -> None:
    """Make the present position of a single-turn encoder its 0; the shaft must rest.

    An arm file and an identification made before no longer fit: their zero_rad belongs
    to the old 0.
    """
    _command("zero", wire.zero_request, line, address, yes=yes, as_json=as_json)


@amt21.command()
def reset(
    *, line: LineOptions, address: Address, yes: Yes = False, as_json: Json = False
) -> None:
    """Restart an encoder, as after power-up; the shaft must rest."""
    _command("reset", wire.reset_request, line, address, yes=yes, as_json=as_json)


def _command(
    name: str,
    request: Callable[[int], bytes],
    where: LineOptions,
    address: str,
    *,
    yes: bool,
    as_json: bool,
) -> None:
    """Show an encoder's position, do something to it, and show it again."""
    number = _address(address)
    with where.opened() as line:
        (before,) = _answering(line, [number])
        # With --json this is printed where the question is.
        typer.echo(f"{number:#04x} is at {before['position']}", err=as_json)
        if not yes:
            typer.confirm(f"{name} this encoder?", abort=True, err=as_json)
        line.command(request(number))
        time.sleep(2 * wire.START_UP_S)
        (after,) = _answering(line, [number])
    now = after["position"]
    report = {"address": number, "before": before["position"], "after": now}
    print_report(report, [f"{number:#04x} is at {now}"], as_json=as_json)


def _address(text: str) -> int:
    try:
        number = int(text, 0)
    except ValueError:
        number = -1
    if not wire.is_address(number):
        refuse(f"--address {text} is none; expected a multiple of 4, from 0x04 to 0xFC")
    return number


def _answering(line: "Amt21Line", addresses: Sequence[int]) -> list[dict[str, Any]]:
    """Return the addresses that answer, with their readings.

    Raises:
        DeviceError: none.
    """
    from traverse.drivers.base.values import DeviceError
    from traverse.drivers.polling.channel import EncoderReading

    line.find_echo(addresses)
    encoders = []
    for address in addresses:
        position = _value(line, wire.position_request(address))
        if position is None:
            continue
        turns = line.ask(wire.turns_request(address))
        encoders.append(
            {
                "address": address,
                "position": position,
                "turns": wire.turns_of(turns.count)
                if isinstance(turns, EncoderReading)
                else None,
            }
        )
    if not encoders:
        raise DeviceError(
            "nothing answers there; the adapter only echoes what is sent",
            "check power, wires A and B, addresses and baud rate",
        )
    return encoders


def _value(line: "Amt21Line", request: bytes) -> int | None:
    from traverse.drivers.polling.channel import EncoderReading

    answers = (line.ask(request) for _ in range(TRIES))
    return next((a.count for a in answers if isinstance(a, EncoderReading)), None)

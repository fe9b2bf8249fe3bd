"""`traverse board`: whether a controller board keeps to the serial protocol."""

import os
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.options import CommandGroup, Json
from traverse.cli.common.refusals import FAILED, device_errors, print_report
from traverse.plurals import counted

if TYPE_CHECKING:
    from traverse.drivers.latch_board.conformance import CheckResult

board = CommandGroup(
    "board",
    help="Controller boards with the serial protocol: test. "
    "The daemon must not be using the port.",
)


@board.command("test")
def check_board(
    port: Annotated[str, typer.Argument(metavar="PORT")],
    *,
    baud_rate: Annotated[int, typer.Option(min=9600, max=12_000_000)] = 1_000_000,
    press: Annotated[float | None, typer.Option(min=1.0, max=300.0)] = None,
    as_json: Json = False,
) -> None:
    """Test whether a board keeps to the serial protocol, and show where it does not.

    Edges that are not yet acknowledged may be lost, and its settings are those of the
    test afterwards. Exit status 1: it does not keep to it.

    Args:
        port: Serial port of the board.
        baud_rate: Baud rate of the line.
        press: Test edges, too; seconds for a press of input 0, and for its release.
    """
    from traverse.drivers.io.serial_port import SerialPort
    from traverse.drivers.latch_board.conformance import BoardTester

    wake_read, wake_write = os.pipe2(os.O_NONBLOCK)
    results = []
    try:
        with (
            device_errors(),
            closing(SerialPort(port, baud_rate, wake_read)) as serial,
        ):
            tester = BoardTester(serial, press, lambda text: typer.echo(text, err=True))
            for result in tester.results():
                results.append(result)
                if not as_json:
                    typer.echo("\n".join(_lines(result)))
    finally:
        os.close(wake_read)
        os.close(wake_write)
    n_failed = sum(result.result == "fail" for result in results)
    report = {
        "port": port,
        "passed": not n_failed,
        "checks": [asdict(result) for result in results],
    }
    end = f"{counted(n_failed, 'check')} failed" if n_failed else "pass"
    print_report(report, [end], as_json=as_json)
    if n_failed:
        raise typer.Exit(FAILED)


def _lines(result: "CheckResult") -> list[str]:
    head = f"{result.result:10}  {result.name} (section {result.section})"
    if result.result == "fail":
        return [head, f"  expected  {result.expected}", f"  came      {result.came}"]
    return [f"{head}: {result.came}" if result.came else head]

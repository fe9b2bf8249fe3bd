"""Entry point: the console script `traverse`, and `python -m traverse`."""

import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated

import typer

try:  # before everything else that computes
    from kinematics.kernel.choice import KERNEL
except ValueError as error:
    sys.stderr.write(f"traverse: {error}\n")
    sys.exit(2)
from traverse.align import align
from traverse.amt21 import amt21
from traverse.arm import arm
from traverse.blind import blind
from traverse.can import can
from traverse.check import check
from traverse.collect import collect
from traverse.demo import demo
from traverse.diagnose import diagnose
from traverse.export import export
from traverse.identify import identify
from traverse.interim import interim
from traverse.microscribe import microscribe
from traverse.page import page
from traverse.points import points
from traverse.probe import probe
from traverse.record import record
from traverse.replay import replay
from traverse.run import run
from traverse.simulate import simulate
from traverse.verify import verify
from traverse.watch import watch

app = typer.Typer(
    name="traverse",
    help="Measurement daemon of an articulated-arm coordinate measuring machine.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: tuple[Callable[..., None], ...] = (
    *(demo, run, simulate, watch, page, check, collect, identify, diagnose, blind),
    *(verify, interim, align, record, replay, export),
)
for command in COMMANDS:
    app.command()(command)
app.add_typer(arm, name="arm")
app.add_typer(amt21, name="amt21")
app.add_typer(can, name="can")
app.add_typer(microscribe, name="microscribe")
app.add_typer(points, name="points")
app.add_typer(probe, name="probe")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"traverse {version('traverse-cmm')} (kernel: {KERNEL})")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_show_version,
            is_eager=True,
            help="Show the version and which kernel computes, then exit.",
        ),
    ] = False,
) -> None:
    """Measurement daemon of an articulated-arm coordinate measuring machine."""


def main() -> None:
    """Run the command line."""
    app()


if __name__ == "__main__":
    main()

"""All commands, and how they end."""

import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from traverse.strict_toml.problems import problem_from_error

try:  # before everything else that computes
    from traverse.kinematics.model.kernel_choice import KERNEL
except ValueError as error:
    sys.stderr.write(f"traverse: {error}\n")
    sys.exit(2)
from traverse.cli.align.command import align
from traverse.cli.arm.command import arm
from traverse.cli.artefact import artefact
from traverse.cli.certify import certify
from traverse.cli.check import check
from traverse.cli.collect.command import collect
from traverse.cli.common.options import CommandGroup
from traverse.cli.common.refusals import REFUSED, RefusalError, end, missing_library
from traverse.cli.control import confirm, label, point, reload, scan, session, undo
from traverse.cli.daily_check import daily_check
from traverse.cli.demo import demo
from traverse.cli.devices.amt21 import amt21
from traverse.cli.devices.can import can
from traverse.cli.devices.microscribe import microscribe
from traverse.cli.diagnose import diagnose
from traverse.cli.export.command import export
from traverse.cli.fleet import fleet
from traverse.cli.gateway.command import gateway
from traverse.cli.identify import identify
from traverse.cli.page import page
from traverse.cli.points.command import points
from traverse.cli.predict import predict
from traverse.cli.probe.command import probe
from traverse.cli.record import record
from traverse.cli.replay import replay
from traverse.cli.run import run
from traverse.cli.simulate import simulate
from traverse.cli.store import store
from traverse.cli.trace import trace
from traverse.cli.verify import verify
from traverse.cli.watch.command import watch


class Commands(TyperGroup):
    """Commands, and how they end where they refuse or lack a library.

    A value of an option that is refused is shown as it was typed.
    """

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - of click, or of typer's own
        """Run the command that is named."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            found = getattr(error.__cause__, "errors", None)  # pydantic's
            if found is not None:
                error.message = problem_from_error(found()[0], ()).message
            raise
        except RefusalError as error:
            end(error.status, f"traverse {self._words(ctx)}: {error}")
        except ModuleNotFoundError as error:
            told = missing_library(self._words(ctx), error)
            if told is None:
                raise
            end(REFUSED, told)

    @staticmethod
    def _words(ctx: typer.Context) -> str:
        """The command's name, behind that of its group."""
        group = ctx.info_name if ctx.parent else None
        return " ".join(filter(None, (group, ctx.invoked_subcommand)))


app = CommandGroup(
    "traverse",
    cls=Commands,
    help="Measurement daemon of an articulated-arm coordinate measuring machine.",
    epilog="Exit status: 0 done; 1 the answer is no; 2 a file or an option was refused;"
    " 3 a device or the broker could not be reached.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # brackets are units here
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS: tuple[Callable[..., None], ...] = (
    *(demo, run, simulate, watch, page, check, artefact, collect),
    *(identify, predict, diagnose, verify, certify, trace),
    *(daily_check, align, record, replay, export, store),
    *(point, undo, scan, label, session, reload, confirm),
)
for command in COMMANDS:
    app.command()(command)
# The old name of `daily-check`, kept for one release.
app.command("interim", hidden=True)(daily_check)
for group in (arm, amt21, can, fleet, gateway, microscribe, points, probe):
    app.add_typer(group, cls=Commands)


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

"""The command line and its exit statuses."""

import os
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from traverse.strict_toml.problems import problem_from_error

if "TRAVERSE_KERNEL" in os.environ:  # before everything else that computes
    try:
        import traverse.kinematics.model.kernel_choice  # noqa: F401 - checks it
    except ValueError as error:
        sys.stderr.write(f"traverse: {error}\n")
        sys.exit(2)
from traverse.cli.common.options import CommandGroup, ConfigCommand
from traverse.cli.common.refusals import REFUSED, RefusalError, end, missing_library

FOLDERS = dict.fromkeys(("amt21", "board", "can", "microscribe"), "devices.")
CONTROL = (
    *("point", "undo", "scan", "label", "session", "reload", "confirm", "home"),
    "send",
)
FORMER_NAMES = {"interim": "daily-check"}
"""Names that commands had; scripts and instructions of others use them. Not listed."""
COMMANDS = (
    *("demo", "setup", "run", "watch", "page", "check", "joints", "artefact"),
    "collect",
    *("identify", "predict", "diagnose", "verify", "certify", "trace"),
    *(
        "daily-check",
        "align",
        "features",
        "record",
        "replay",
        "export",
        "store",
        "extensions",
    ),
    *(*CONTROL, *FORMER_NAMES),
    *(
        "simulate",
        "arm",
        "campaign",
        "amt21",
        "board",
        "can",
        "fleet",
        "gateway",
        "microscribe",
        "points",
        "probe",
    ),
    "help",
)
"""Commands, then groups of commands, in the order of the help."""


class Commands(TyperGroup):
    """The command group; converts refusals and missing libraries to exit statuses.

    A refused option value is shown as it was typed.
    """

    def invoke(self, ctx: Any) -> Any:  # noqa: ANN401 - of click, or of typer's own
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            errors = getattr(error.__cause__, "errors", None)  # pydantic's
            if errors is not None:
                error.message = problem_from_error(errors()[0], ()).message
            raise
        except RefusalError as error:
            end(error.status, f"traverse {self._words(ctx)}: {error}")
        except ModuleNotFoundError as error:
            hint = missing_library(self._words(ctx), error)
            if hint is None:
                raise
            end(REFUSED, hint)

    @staticmethod
    def _words(ctx: typer.Context) -> str:
        group = ctx.info_name if ctx.parent else None
        return " ".join(filter(None, (group, ctx.invoked_subcommand)))


def _show_version(is_asked: bool) -> None:
    if is_asked:
        from traverse.kinematics.model.kernel_choice import KERNEL

        typer.echo(f"traverse {version('traverse-cmm')} (kernel: {KERNEL})")
        raise typer.Exit


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


def command_line(names: Iterable[str]) -> CommandGroup:
    group = CommandGroup(
        "traverse",
        cls=Commands,
        help="Measurement daemon of an articulated-arm coordinate measuring machine.",
        epilog="Exit status: 0 done; 1 the answer is no; 2 a file or an option was "
        "refused; 3 a device or the broker could not be reached.",
        pretty_exceptions_enable=False,
        rich_markup_mode=None,  # brackets are units here
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    group.callback()(_options)
    for name in names:
        command = _command(FORMER_NAMES.get(name, name).replace("-", "_"))
        if isinstance(command, CommandGroup):
            group.add_typer(command, cls=Commands)
        elif name in FORMER_NAMES:
            group.command(name, hidden=True)(command)
        elif name == "run":
            group.command(cls=ConfigCommand)(command)
        else:
            group.command("help" if name == "help" else None)(command)
    return group


def _command(name: str) -> Any:  # noqa: ANN401 - a function, or a group
    """Import a command, or group, from the module or package that has its name."""
    place = "control" if name in CONTROL else f"{FOLDERS.get(name, '')}{name}"
    module = import_module(f"traverse.cli.{place}")
    if name == "help":  # whose name is that of a builtin
        return module.show_help
    if hasattr(module, "__path__"):
        module = import_module(f"{module.__name__}.command")
    return getattr(module, name)


def __getattr__(name: str) -> CommandGroup:
    """Make `app`, the whole command line, on first access."""
    if name != "app":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return command_line(COMMANDS)


def requested() -> CommandGroup:
    """Make the command line for the arguments: of the command that they begin with."""
    first = sys.argv[1:2]
    return command_line(first if {*first} & {*COMMANDS} else COMMANDS)


def main() -> None:
    requested()()


if __name__ == "__main__":
    main()

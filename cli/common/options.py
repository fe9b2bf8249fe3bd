"""Commands as plain functions, whose docstrings have the help; options they share."""

import copy
import functools
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from typer.core import TyperCommand
from typer.models import CommandFunctionType

Json = Annotated[
    bool, typer.Option("--json", help="Report as JSON on standard output.")
]
Yes = Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")]
Force = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
Operator = Annotated[
    str | None,
    typer.Option(
        help="Who computes, for the report; else TRAVERSE_OPERATOR, else user@host."
    ),
]
HoldoutBy = Annotated[
    Literal["time", "artefact"],
    typer.Option(help="Keep aside groups of poses in time, or whole artefacts."),
]
_SHORT = {"out": "-o", "config": "-c"}
Command = Callable[..., None]
_ENTRY = re.compile(r"^    (\w+): (.+(?:\n {8}.+)*)", re.MULTILINE)


def campaign_folder(path: Path | None) -> Path | None:
    """Take the folder where its campaign.toml is named; for arguments."""
    return path.parent if path is not None and path.name == "campaign.toml" else path


class ConfigCommand(TyperCommand):
    """A command whose argument is a configuration: `--config` may stand before it.

    Elsewhere it is an option, so that people write it here, too.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - typer's own click
        """Parse the arguments without the option's name."""
        without = [a.removeprefix("--config=") for a in args]
        return super().parse_args(
            ctx, [a for a in without if a not in ("--config", "-c")]
        )


class CommandGroup(typer.Typer):
    """Commands, registered as functions of which typer shows the docstrings.

    A parameter is an option where it can be given by its name only, else an argument;
    `Annotated` has what is more to say than its type and default. Its help is its entry
    in the docstring's section `Args`. Options of one name are alike: `out` is also -o,
    `config` -c, `arm` is --arm for a file and --arm-name for a name. A bool that is
    False unless given has no opposite (`--no-...`). A parameter of a dataclass stands
    for the options that are its fields, with their help in the section `Attributes` of
    the class.
    """

    def __init__(self, name: str, **settings: Any) -> None:
        super().__init__(name=name, no_args_is_help=True, **settings)

    def command(
        self, name: str | None = None, **settings: Any
    ) -> Callable[[CommandFunctionType], CommandFunctionType]:
        register = super().command(name, **settings)

        def decorated(command: CommandFunctionType) -> CommandFunctionType:
            register(_with_help(command))
            return command

        return decorated


def _with_help(command: Command) -> Command:
    """Wrap a command so that typer sees its parameters with their help."""
    parameters_of_command = inspect.signature(command, eval_str=True).parameters
    about, entries = _parts(command)
    groups = {
        name: _options(p.annotation)
        for name, p in parameters_of_command.items()
        if _is_group(p)
    }
    parameters = [
        parameter
        for name, declared in parameters_of_command.items()
        for parameter in groups.get(name) or (_described(declared, entries),)
    ]

    @functools.wraps(command)
    def called(**arguments: Any) -> None:
        for name, options in groups.items():
            values = {option.name: arguments.pop(option.name) for option in options}
            arguments[name] = parameters_of_command[name].annotation(**values)
        command(**arguments)

    # What typer reads.
    called.__doc__ = about
    called.__annotations__ = {added.name: added.annotation for added in parameters}
    called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # of PEP 362
    return called


def _is_group(parameter: inspect.Parameter) -> bool:
    return is_dataclass(parameter.annotation)


@functools.cache
def _options(group: type) -> tuple[inspect.Parameter, ...]:
    _, entries = _parts(group)
    fields = inspect.signature(group, eval_str=True).parameters.values()
    return tuple(_described(field, entries) for field in fields)


def _parts(documented: object) -> tuple[str, dict[str, str]]:
    """Split a docstring: its text, and its entries by name."""
    docstring = inspect.getdoc(documented) or ""
    about, *sections = re.split(r"\n\n(?:Args|Attributes):\n", docstring)
    entries = _ENTRY.findall("".join(sections))
    return about, {name: " ".join(text.split()) for name, text in entries}


def _described(
    parameter: inspect.Parameter, entries: Mapping[str, str]
) -> inspect.Parameter:
    """Annotate a parameter for typer, with its help where it has none."""
    kind, name, default = parameter.annotation, parameter.name, parameter.default
    is_option = parameter.kind is parameter.KEYWORD_ONLY
    # All by name, as the order of those with defaults does not matter then.
    parameter = parameter.replace(kind=parameter.KEYWORD_ONLY)
    if get_origin(kind) is Annotated:
        kind, info = get_args(kind)
        info = copy.copy(info)
        info.help = info.help or entries.get(name)
        info.readable = False
        return parameter.replace(annotation=Annotated[kind, info])
    of_typer = typer.Option if is_option else typer.Argument
    flag = [f"--{name.replace('_', '-')}"] if kind is bool and not default else []
    if is_option and name in _SHORT:
        flag = [f"--{name}", _SHORT[name]]
    elif is_option and name == "arm" and str in (kind, *get_args(kind)):
        flag = ["--arm-name"]  # at a broker; --arm is a file
    typer_default = ... if default is parameter.empty else default
    # Who reads a file refuses it, with its owner.
    info = of_typer(typer_default, *flag, help=entries.get(name), readable=False)
    return parameter.replace(default=info)

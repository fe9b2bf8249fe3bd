"""Options that commands share, and groups of them as one value."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

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
Command = Callable[..., None]


def campaign_folder(path: Path | None) -> Path | None:
    """Take the folder where its campaign.toml is named; for arguments."""
    return path.parent if path is not None and path.name == "campaign.toml" else path


def with_options(parameter: str, group: type[Any]) -> Callable[[Command], Command]:
    """Replace a command's parameter with the options of a group.

    Args:
        parameter: of the command; it is called with an instance of the group there.
        group: a dataclass of annotated options, in the order of `--help`.
    """

    def replaced(command: Command) -> Command:
        ours = inspect.signature(group).parameters
        own = inspect.signature(command, eval_str=True)
        parameters = [
            one
            for name, mine in own.parameters.items()
            for one in (ours.values() if name == parameter else (mine,))
        ]

        @functools.wraps(command)
        def called(**given: Any) -> None:  # noqa: ANN401 - options of all kinds
            options = group(**{name: given.pop(name) for name in ours})
            command(**given, **{parameter: options})

        # What typer reads.
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        signature = own.replace(parameters=parameters)
        called.__signature__ = signature  # type: ignore[attr-defined]  # of PEP 362
        return called

    return replaced

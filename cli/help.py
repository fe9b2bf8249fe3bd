"""`traverse help`: the help of a command, as `traverse COMMAND --help` has it."""

import sys
from typing import Annotated

import typer

from traverse.cli.common.refusals import refuse


def show_help(
    words: Annotated[list[str] | None, typer.Argument(metavar="COMMAND")] = None,
) -> None:
    """Show the help of a command, or of all.

    Args:
        words: Its words, such as `arm show`.
    """
    from traverse.cli.__main__ import app

    group = typer.main.get_command(app)
    context = typer.Context(group, info_name="traverse")
    for word in words or ():
        known = getattr(group, "commands", {})
        if word not in known:
            refuse(f"there is no command {word!r}; known here: {', '.join(known)}")
        group = known[word]
        context = typer.Context(group, info_name=word, parent=context)
    sys.stdout.write(f"{group.get_help(context)}\n")

"""How the commands of the lab refuse: exit status 2 and a sentence."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer

REFUSED = 2

_EXTRA = ("scipy", "matplotlib")


def refuse(command: str, text: str) -> NoReturn:
    """End a command with a sentence about what was wrong."""
    typer.echo(f"traverse {command}: {text}", err=True)
    raise typer.Exit(REFUSED)


@contextmanager
def refusals(command: str) -> Iterator[None]:
    """End with exit status 2 where something is refused, missing or not writable."""
    from kinematics.arm_file import FileError  # noqa: PLC0415 - keeps --help quick

    try:
        yield
    except FileError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(REFUSED) from error
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in _EXTRA:
            raise
        typer.echo(
            f"traverse {command} needs {package}, which is not installed; install the "
            "extra `lab`: pip install 'traverse-cmm[lab]'",
            err=True,
        )
        raise typer.Exit(REFUSED) from error
    except OSError as error:
        typer.echo(f"{error.filename}: {error.strerror}; check the path", err=True)
        raise typer.Exit(REFUSED) from error

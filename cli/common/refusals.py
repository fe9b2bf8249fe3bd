"""How commands refuse: exit status 2 and a sentence."""

import errno
import json
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import typer

from traverse.installation import EXTRAS, missing
from traverse.strict_toml.problems import FileError, system_reason

FAILED, REFUSED, UNREACHABLE, IN_DOUBT = 1, 2, 3, 4

_OF_THE_LAB = (
    "align",
    "artefact",
    "certify",
    "daily-check",
    "diagnose",
    "features",
    "identify",
    "predict",
    "probe",
    "trace",
    "verify",
)


def missing_library(command: str, error: ModuleNotFoundError) -> str | None:
    """A sentence about a library of an extra that is not installed; else None.

    `command` is the words after `traverse`.
    """
    package = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(package)
    if extra is None:
        return None
    if extra == "daemon" and command.partition(" ")[0] in _OF_THE_LAB:
        extra = "lab"  # which contains what these need of the other
    return missing(f"traverse {command}", package, extra)


def end(status: int, text: str) -> NoReturn:
    """End a command with a sentence on standard error."""
    typer.echo(text, err=True)
    raise typer.Exit(status)


class RefusalError(Exception):
    """Ends a command with a sentence after the command's name.

    Args:
        text: the sentence.
        status: exit status.
    """

    def __init__(self, text: str, status: int = REFUSED) -> None:
        super().__init__(text)
        self.status = status


def refuse(text: str, status: int = REFUSED) -> NoReturn:
    """End a command with a sentence that names the mistake."""
    raise RefusalError(text, status)


def print_report(values: Any, lines: Iterable[str], *, as_json: bool) -> None:  # noqa: ANN401 - for json
    """Print values as JSON, dates as texts, or lines for people."""
    if as_json:
        typer.echo(json.dumps(values, indent=1, default=str, ensure_ascii=False))
    else:
        typer.echo("\n".join(lines))


def end_by_state(state: str, *, strict: bool) -> None:
    """End a command by the state of its result; in doubt only where it is strict."""
    if state == "bad":
        raise typer.Exit(FAILED)
    if strict and state != "good":
        raise typer.Exit(IN_DOUBT)


def system_refusal(error: OSError) -> str:
    if error.filename is None:
        return system_reason(error)
    path = Path(str(error.filename))
    if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
        return f"{path}: there is no folder {path.parent}; make it first"
    return f"{path}: {system_reason(error)}"


def check_inputs(*paths: Path | None) -> None:
    """Refuse files and folders that are not there, before any work; None is none."""
    missing = [str(path) for path in paths if path is not None and not path.exists()]
    if missing:
        reason = system_reason(
            FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        )
        refuse("; ".join(f"{path}: cannot be read: {reason}" for path in missing))


def check_target(path: Path | None, *, force: bool) -> None:
    """Refuse a file that cannot be written, or that is there, before any work."""
    if path is None:
        return
    if not path.parent.is_dir():
        refuse(f"{path}: there is no folder {path.parent}; make it first")
    if path.is_dir():
        refuse(f"{path} is a folder; name a file in it")
    if path.exists() and not force:
        refuse(f"{path} exists; name another, or replace it with --force")


def check_results(folder: Path, arm: Path) -> None:
    """Refuse an impossible folder of results of the arm file, before any work."""
    if folder.exists() and not folder.is_dir():
        refuse(f"--out {folder} is no folder; name one, or one that is yet to be made")
    # os.path: Path.resolve raises RuntimeError where a link leads to itself.
    if os.path.realpath(folder / "arm.toml") == os.path.realpath(arm):
        problem = f"--out {folder}: its arm.toml is the arm file, and would be replaced"
        refuse(f"{problem}; name another folder")


@contextmanager
def client_errors() -> Iterator[None]:
    """End with exit status 2 where the arm refuses, 3 where it is not reached."""
    from traverse.client.errors import ClientError, CommandRefused

    # Errors end the command with the same text.
    logging.getLogger("traverse.client").addHandler(logging.NullHandler())
    try:
        yield
    except (CommandRefused, ValueError) as error:
        refuse(str(error))
    except ClientError as error:
        refuse(str(error), UNREACHABLE)


@contextmanager
def device_errors() -> Iterator[None]:
    """End with exit status 3 where a device cannot be reached."""
    from traverse.drivers.base.values import DeviceError

    try:
        yield
    except DeviceError as error:
        end(UNREACHABLE, f"{error}; {error.remedy}")


@contextmanager
def refusals(*kinds: type[Exception]) -> Iterator[None]:
    """End with exit status 2 where something is refused or not writable.

    Errors of these kinds are refusals, too.
    """
    try:
        yield
    except FileError as error:
        end(REFUSED, str(error))
    except kinds as error:
        refuse(str(error))
    except OSError as error:
        end(REFUSED, system_refusal(error))

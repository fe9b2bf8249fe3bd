"""How commands refuse: exit status 2 and a sentence."""

import json
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import typer

from traverse.installation import EXTRAS, missing

FAILED, REFUSED, UNREACHABLE = 1, 2, 3

_OF_THE_LAB = (
    "align",
    "artefact",
    "certify",
    "daily-check",
    "diagnose",
    "identify",
    "interim",
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


def refuse(command: str, text: str) -> NoReturn:
    """End a command with a sentence about what was wrong."""
    end(REFUSED, f"traverse {command}: {text}")


def print_report(values: Any, lines: Iterable[str], *, as_json: bool) -> None:  # noqa: ANN401 - for json
    """Print values as JSON, dates as texts, or lines for people."""
    text = json.dumps(values, indent=1, default=str) if as_json else "\n".join(lines)
    typer.echo(text)


def system_refusal(error: OSError) -> str:
    """Return which file or folder the system refuses, why, and what to do."""
    from traverse.strict_toml.problems import system_reason  # noqa: PLC0415

    if error.filename is None:
        return system_reason(error)
    path = Path(str(error.filename))
    if isinstance(error, FileNotFoundError) and not path.parent.is_dir():
        return f"{path}: there is no folder {path.parent}; make it first"
    return f"{path}: {system_reason(error)}"


def check_target(command: str, path: Path, *, force: bool) -> None:
    """Refuse a file that cannot be written, or that is there, before any work."""
    if not path.parent.is_dir():
        refuse(command, f"{path}: there is no folder {path.parent}; make it first")
    if path.is_dir():
        refuse(command, f"{path} is a folder; name a file in it")
    if path.exists() and not force:
        refuse(command, f"{path} exists; name another, or replace it with --force")


def check_results(command: str, folder: Path, arm: Path) -> None:
    """Refuse a folder of results whose arm.toml is the arm file that is read."""
    # os.path: Path.resolve raises RuntimeError where a link leads to itself.
    if os.path.realpath(folder / "arm.toml") == os.path.realpath(arm):
        told = f"--out {folder}: its arm.toml is the arm file, and would be replaced"
        refuse(command, f"{told}; name another folder")


@contextmanager
def client_errors(command: str) -> Iterator[None]:
    """End with exit status 2 where the arm refuses, 3 where it is not reached."""
    from traverse.client.errors import ClientError, CommandRefused  # noqa: PLC0415

    # Errors end the command with the same text.
    logging.getLogger("traverse.client").addHandler(logging.NullHandler())
    try:
        yield
    except (CommandRefused, ValueError) as error:
        refuse(command, str(error))
    except ClientError as error:
        end(UNREACHABLE, f"traverse {command}: {error}")


@contextmanager
def device_errors() -> Iterator[None]:
    """End with exit status 3 where a device cannot be reached."""
    from traverse.drivers.base.values import DeviceError  # noqa: PLC0415

    try:
        yield
    except DeviceError as error:
        end(UNREACHABLE, f"{error}; {error.remedy}")


@contextmanager
def refusals(command: str) -> Iterator[None]:
    """End with exit status 2 where something is refused, missing or not writable."""
    from traverse.strict_toml.problems import FileError  # noqa: PLC0415

    try:
        yield
    except FileError as error:
        end(REFUSED, str(error))
    except ModuleNotFoundError as error:
        told = missing_library(command, error)
        if told is None:
            raise
        end(REFUSED, told)
    except OSError as error:
        end(REFUSED, system_refusal(error))

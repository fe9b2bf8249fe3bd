"""Results that many tests look at: made once, for all workers of a session."""

import fcntl
import functools
import os
import pickle
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from tests.warm_start import FOLDER

Function = TypeVar("Function", bound=Callable[..., object])


def new_folder() -> Path:
    return Path(tempfile.mkdtemp(dir=os.environ.get(FOLDER)))


def shared(function: Function) -> Function:
    """Call a module's function once in a session for each of its arguments.

    Strategy: the first worker computes and writes a file, the others wait for it
    and read it. Without a session (a test module that is imported by itself) each
    process computes. Arguments are told apart by their repr.
    """

    @functools.cache
    def cached(*arguments: object, **named: object) -> object:
        if FOLDER not in os.environ:
            return function(*arguments, **named)
        call = f"{arguments!r}{named!r}" if named else f"{arguments!r}"
        name = f"{function.__module__}.{function.__qualname__}{call}"
        file = Path(os.environ[FOLDER]) / name.replace("/", "_")
        with file.with_name(f"{file.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if file.exists():
                return pickle.loads(file.read_bytes())
            result = function(*arguments, **named)
            part = file.with_name(f"{file.name}.part")
            part.write_bytes(pickle.dumps(result))
            part.rename(file)
            return result

    return functools.wraps(function)(cached)  # type: ignore[return-value]

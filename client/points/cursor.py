"""A consumer's place in a file, for restarts."""

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

from traverse.protocol.message_error import MessageError
from traverse.strict_toml.files import json_of, lock_alone

SCHEMA = "traverse/place/1"


def read_cursor(path: Path, arm: str) -> dict[str, int] | None:
    """Read next numbers of sessions, the newest last; None without a file.

    Raises:
        MessageError: it is not such a file, or belongs to another arm.
        OSError: it cannot be read.
    """
    try:
        values = json_of(path)
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise MessageError.of(str(path), str(error), "JSON") from error
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        raise MessageError.of(
            str(path), repr(values)[:80], f'a map with schema "{SCHEMA}"'
        )
    if values.get("arm") != arm:
        stated = repr(values.get("arm"))[:80]
        raise MessageError.of(f"{path}: arm", stated, f"{arm!r}; give it its own file")
    sessions = values.get("sessions")
    if not isinstance(sessions, dict) or not all(
        type(seq) is int and seq >= 0 for seq in sessions.values()
    ):
        stated = repr(sessions)[:80]
        raise MessageError.of(f"{path}: sessions", stated, "a map to integers from 0")
    return sessions


def write_cursor(path: Path, arm: str, place: dict[str, int]) -> None:
    """Write it whole or not at all, also when the power fails."""
    text = json.dumps({"schema": SCHEMA, "arm": arm, "sessions": place}, indent=1)
    beside = path.with_name(f"{path.name}.new")
    with beside.open("w", encoding="utf-8") as file:
        file.write(text + "\n")
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


@contextlib.contextmanager
def held_cursor(path: Path) -> Iterator[None]:
    """Hold a cursor's file for one consumer within the block.

    The place of another one would leave out points that this one still lacks. The
    file is replaced at each change, so that a file beside it is locked, which is there
    only meanwhile.

    Raises:
        OSError: another program holds it, or no file can be made there.
    """
    beside = path.with_name(f"{path.name}.lock")
    with contextlib.ExitStack() as stack:
        while True:
            descriptor = os.open(beside, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            stack.callback(os.close, descriptor)
            lock_alone(descriptor, path, "keeps its place in it")
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), beside.stat()):
                    break  # else its holder has just ended and taken it away
        stack.callback(beside.unlink, missing_ok=True)
        yield

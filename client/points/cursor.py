"""A consumer's place in a file, for restarts."""

import json
import os
from pathlib import Path

from traverse.protocol.message_error import MessageError
from traverse.strict_toml.files import json_of

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

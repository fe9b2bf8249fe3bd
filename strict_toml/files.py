"""Opening files that people name: regular ones of a bounded size, in bounded pieces.

A device such as /dev/zero never ends and a FIFO waits for ever: both are refused. What
cannot be read leaves as OSError with a reason, as the system's own refusals do.
"""

import errno
import fcntl
import io
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

MOST_BYTES = 64 * 2**20  # of a file that is read whole; recordings and tables are not
MOST_TOML_BYTES = 8 * 2**20  # whose values take a hundred times as much memory
MOST_LINE = 2**20  # characters of a line


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading.

    Raises:
        OSError: It cannot be read, or is something else than a regular file.
    """
    # Without O_NONBLOCK the opening of a FIFO would wait for a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise OSError(errno.EINVAL, "is not a regular file", str(path))
    return os.fdopen(descriptor, "rb")


def lock_alone(descriptor: int, path: Path, use: str) -> None:
    """Lock an open file or folder for one program; the lock ends when it is closed.

    A file system without locks lets all use it.

    Args:
        descriptor: Of the open file or folder.
        path: Its name, for people.
        use: The other program's use of it, for people ("appends to it").

    Raises:
        OSError: Another program has it locked.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise OSError(errno.EBUSY, f"another program {use}", str(path)) from error
    except OSError:
        return


@contextmanager
def locked_folder(path: Path, use: str) -> Iterator[None]:
    """Hold a folder within the block; as `lock_alone`.

    Raises:
        OSError: Another program holds it, or it cannot be opened.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        lock_alone(descriptor, path, use)
        yield
    finally:
        os.close(descriptor)


def bytes_of(path: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """Read a whole file of at most so many bytes.

    Raises:
        OSError: It cannot be read, is larger, or is not a regular file.
    """
    with open_regular(path) as file:
        content = file.read(most_bytes + 1)
    if len(content) > most_bytes:
        problem = f"is larger than {most_bytes // 2**20} MiB"
        raise OSError(errno.EFBIG, problem, str(path))
    return content


def text_of(path: Path) -> str:
    """Read a whole file as UTF-8.

    Raises:
        OSError: As `bytes_of`.
        UnicodeDecodeError: It is not UTF-8.
    """
    return bytes_of(path).decode("utf-8")


def json_of(path: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    """Read a file of JSON, without NaN and infinity.

    Raises:
        OSError: As `bytes_of`.
        ValueError: It is not JSON, nested too deep, or has a number out of range.
    """

    def number(text: str) -> float:
        value = float(text)
        if value in (float("inf"), float("-inf")):
            raise ValueError(f"{text[:40]} is out of range")
        return value

    def no_number(text: str) -> None:
        raise ValueError(f"{text} is not a finite number")

    text = text_of(path)
    try:
        return json.loads(text, parse_float=number, parse_constant=no_number)
    except RecursionError as error:
        raise ValueError("is nested too deep") from error


@contextmanager
def text_lines(path: Path) -> Iterator[Iterator[str]]:
    """Lines of a file in UTF-8, each of at most `MOST_LINE` characters.

    Raises:
        OSError: It cannot be read, or is not a regular file.
        ValueError: While it is read: a line is longer.
    """
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", newline="") as file:
        yield _bounded(file)


def _bounded(file: TextIO) -> Iterator[str]:
    while line := file.readline(MOST_LINE + 1):
        if len(line) > MOST_LINE:
            raise ValueError(f"a line has more than {MOST_LINE} characters")
        yield line

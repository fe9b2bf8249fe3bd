"""The logo of a report: a picture that is part of the page itself."""

import base64
from pathlib import Path

from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.problems import FileError

_MOST_BYTES = 500_000
_KINDS = {b"\x89PNG\r\n\x1a\n": "png", b"\xff\xd8\xff": "jpeg"}


def logo_uri(path: Path) -> str:
    """Read a picture as a data URI.

    Raises:
        FileError: It is none, or cannot be read.
    """
    try:
        content = bytes_of(path, _MOST_BYTES)
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}; expected a small picture"
        raise FileError(path, problem) from error
    kinds = (kind for head, kind in _KINDS.items() if content.startswith(head))
    kind = next(kinds, None)
    if kind is None:
        raise FileError(path, "is no picture in PNG or JPEG; save the logo as one")
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"

"""Files that may be credentials of systemd (LoadCredential=)."""

import os
import re
from pathlib import Path

CREDENTIAL = "credential:"
_NAME = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,255}")


def credential_file(name: str, folder: Path = Path()) -> Path:
    """The file that a name means: `credential:NAME`, or one in a folder.

    Raises:
        ValueError: it is no name of a credential, or systemd has passed none.
    """
    if not name.startswith(CREDENTIAL):
        return folder / name
    credential = name.removeprefix(CREDENTIAL)
    if not _NAME.fullmatch(credential):
        raise ValueError(
            f"{name!r} is no name of a credential; use letters, digits, '.', '_', '-'"
        )
    credentials = os.environ.get("CREDENTIALS_DIRECTORY")
    if credentials is None:
        raise ValueError(
            f"{name!r} is a credential of systemd, and $CREDENTIALS_DIRECTORY is not "
            f"set; start it by a unit with LoadCredential={credential}:FILE, or name a "
            "file"
        )
    return Path(credentials) / credential

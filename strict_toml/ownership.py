"""Whose a file or folder is that the system does not let this program use."""

import os
import pwd
from pathlib import Path


def reason_of_owner(error: BaseException) -> str:
    """Return `refused_owner` of an error's file; empty for other errors."""
    if not isinstance(error, PermissionError) or error.filename is None:
        return ""
    return refused_owner(Path(os.fsdecode(error.filename)))


def refused_owner(path: Path) -> str:
    """Return why this program may not use a file, whose it is, and the remedy.

    It is the first folder above the file that cannot be entered, else the file, or the
    folder that it would be made in. Empty where their rights allow all.
    """
    place = _refused_place(path.absolute())
    if place is None:
        return ""
    try:
        status = place.stat()
    except OSError:
        return ""
    mode = f"mode {status.st_mode & 0o7777:04o}"
    if status.st_uid == os.geteuid():
        return f"{place} has {mode}, which its owner cannot use; chmod u+rwX {place}"
    user = _user_name(os.geteuid())
    remedy = f"give it to {user}: chown {user} {place}"
    if status.st_uid:  # a service does not run as root to read a file
        remedy = f"run it as {_user_name(status.st_uid)}, or {remedy}"
    return (
        f"{place} belongs to {_user_name(status.st_uid)} ({mode}), and this program "
        f"runs as {user}; {remedy}"
    )


def _refused_place(path: Path) -> Path | None:
    for folder in reversed(path.parents):
        if folder.is_dir() and not _has_right(folder, os.X_OK):
            return folder
    if not path.exists():
        return None if _has_right(path.parent, os.W_OK) else path.parent
    right = os.R_OK | os.W_OK | (os.X_OK if path.is_dir() else 0)
    return None if _has_right(path, right) else path


def _has_right(path: Path, right: int) -> bool:
    return os.access(path, right, effective_ids=os.access in os.supports_effective_ids)


def _user_name(number: int) -> str:
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"

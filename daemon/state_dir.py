"""The state folder of an arm's daemon."""

import os
from pathlib import Path

from traverse.strict_toml.ownership import reason_of_owner

OUTBOX = "outbox.db"
SCANS = "scans.db"
RECORDINGS = "recordings"
REFERENCES = "references.json"
UTC = "utc.json"
PROBE = "probe.json"
DOUBTS = "doubts.jsonl"
OWNER_ONLY = 0o700


def state_path(configuration_path: Path) -> Path:
    """Return the path of the state folder.

    It is the first entry of `$STATE_DIRECTORY`, which systemd sets for
    `StateDirectory=`; else `state` beside the configuration.
    """
    folder = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(folder) if folder else configuration_path.parent / "state"


def state_folder(configuration_path: Path) -> Path:
    """Create the state folder for its owner alone if it is missing.

    Raises:
        OSError: it cannot be made.
    """
    folder = state_path(configuration_path)
    folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
    return folder


def unusable(error: OSError) -> str:
    """Return why a state folder, or a file in it, cannot be used, and what to do."""
    if owner := reason_of_owner(error):
        return f"the state folder cannot be used: {owner}"
    why = error.strerror
    if isinstance(error, FileExistsError | NotADirectoryError):
        why = "it, or a folder above it, is no folder, or a link to nothing"
    return (
        f"the state folder cannot be used: {why}; make it a folder that the daemon's "
        "user can read and write, or set STATE_DIRECTORY to another"
    )

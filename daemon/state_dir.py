"""Where the daemon keeps what must outlive it: one folder for each arm."""

import os
from pathlib import Path

OUTBOX = "outbox.db"
SCANS = "scans.db"
RECORDINGS = "recordings"
REFERENCES = "references.json"
UTC = "utc.json"
OWNER_ONLY = 0o700


def state_path(configuration_path: Path) -> Path:
    """Where the folder is, or would be.

    The first entry of `$STATE_DIRECTORY`, which systemd sets for a unit with
    `StateDirectory=`; else `state` beside the configuration.
    """
    folder = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(folder) if folder else configuration_path.parent / "state"


def state_folder(configuration_path: Path) -> Path:
    """The folder, made for its owner alone where it is missing.

    Raises:
        OSError: it cannot be made.
    """
    folder = state_path(configuration_path)
    folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
    return folder

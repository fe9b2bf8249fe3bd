"""Where the daemon keeps what must outlive it: one folder for each arm."""

import os
from pathlib import Path

OUTBOX = "outbox.db"
RECORDINGS = "recordings"
OWNER_ONLY = 0o700


def state_folder(configuration_path: Path) -> Path:
    """The folder, made for its owner alone where it is missing.

    The first entry of `$STATE_DIRECTORY`, which systemd sets for a unit with
    `StateDirectory=`; else `state` beside the configuration.

    Raises:
        OSError: it cannot be made.
    """
    told = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    folder = Path(told) if told else configuration_path.parent / "state"
    folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
    return folder

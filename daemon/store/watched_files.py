"""Notice that a database's files were moved, removed or cut off by somebody else."""

from collections.abc import Mapping
from pathlib import Path


class WatchedFiles:
    """Identities and sizes of files that no other program should change.

    Down to a limit for each, their owner may shorten them.
    """

    def __init__(self) -> None:
        self._known: dict[Path, tuple[tuple[int, int] | None, int]] = {}

    @property
    def are_unchanged(self) -> bool:
        """Whether all are those that were noted, and none is shorter."""
        for path, (identity, n_bytes) in self._known.items():
            present, present_bytes = _identity_and_size(path)
            if present != identity or present_bytes < n_bytes:
                return False
        return True

    def note(self, limits_bytes: Mapping[Path, int]) -> None:
        """Note files as they are, with sizes up to a limit each."""
        self._known = {}
        for path, limit_bytes in limits_bytes.items():
            identity, n_bytes = _identity_and_size(path)
            self._known[path] = identity, min(n_bytes, limit_bytes)

    def note_growth(self, path: Path, limit_bytes: int) -> None:
        """Note that a file that is still the same has grown."""
        identity, n_bytes = self._known[path]
        present, present_bytes = _identity_and_size(path)
        if present == identity:
            n_bytes = max(n_bytes, min(present_bytes, limit_bytes))
            self._known[path] = identity, n_bytes


def _identity_and_size(path: Path) -> tuple[tuple[int, int] | None, int]:
    """Return identity and size of a file; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None, 0
    return (status.st_dev, status.st_ino), status.st_size

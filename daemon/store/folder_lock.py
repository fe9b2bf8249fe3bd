"""Create the state folder of the outbox, and lock it for this process."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from traverse.daemon.state_dir import OWNER_ONLY, lock_directory
from traverse.daemon.store.records import StoreRefusedError


@contextlib.contextmanager
def exclusive_state_dir(folder: Path) -> Iterator[None]:
    """Use a state folder as the only daemon.

    Raises:
        StoreRefusedError: another one does, or it cannot be had.
    """
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
            stack.enter_context(lock_directory(folder))
        except BlockingIOError as error:
            raise StoreRefusedError(
                f"{folder}: another daemon uses this state folder; end it, or give "
                "this one a configuration in another folder"
            ) from error
        except OSError as error:
            raise StoreRefusedError(
                f"{folder}: the state folder cannot be used: {error.strerror}; make it "
                "writable for the daemon's user, or set STATE_DIRECTORY to another"
            ) from error
        yield

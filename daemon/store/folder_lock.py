"""Create the state folder of the outbox, and lock it for this process."""

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from traverse.daemon.state_dir import OWNER_ONLY
from traverse.daemon.store.records import StoreRefusedError


@contextlib.contextmanager
def exclusive_state_dir(folder: Path) -> Iterator[None]:
    """Use a state folder as the only daemon.

    The lock is one of the system's, on the folder itself: it ends with the process,
    however that ends, and needs no file.

    Raises:
        StoreRefusedError: another one does, or it cannot be had.
    """
    with contextlib.ExitStack() as stack:
        try:
            folder.mkdir(mode=OWNER_ONLY, parents=True, exist_ok=True)
            descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
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

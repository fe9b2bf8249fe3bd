"""The limit of open files and sockets: raised where it may be, refused where too low.

At the limit nothing can be opened: neither a port that comes back, nor the outbox after
a full disk, nor a module that is imported when it is first needed.
"""

import resource

LEAST_FILES = 64
"""An arm's daemon has some 25 open, each further device two more."""
AMPLE_FILES = 1024


def ensure_open_files() -> None:
    """Raise this process's limit to an ample one, as far as the hard limit allows.

    Raises:
        ValueError: too few files may be open.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= AMPLE_FILES:
        return
    most = AMPLE_FILES if hard == resource.RLIM_INFINITY else min(hard, AMPLE_FILES)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if most < LEAST_FILES:
        raise ValueError(
            f"this process may have {most} files and sockets open; the daemon requires "
            f"{LEAST_FILES}; raise the limit (LimitNOFILE= of its unit, or "
            f"`ulimit -Hn {AMPLE_FILES}`)"
        )

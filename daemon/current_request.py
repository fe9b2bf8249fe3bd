"""Context variable with the request of the running command.

A point is stored with the request that took it, so that the same request repeated after
a crash gets its first answer and takes no second point. Each command runs in a task of
its own; the modules between need not pass the request on.
"""

from contextvars import ContextVar

CURRENT_REQUEST: ContextVar[str | None] = ContextVar("CURRENT_REQUEST", default=None)

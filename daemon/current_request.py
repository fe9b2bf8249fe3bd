"""The request of the command that is being executed.

A point that a command takes is stored together with that, so that the same request,
repeated after a crash, gets its first answer and takes no second point. It is a context
variable: each command is executed by a task of its own, and between the two lie modules
that do not concern themselves with commands.
"""

from contextvars import ContextVar

CURRENT_REQUEST: ContextVar[str | None] = ContextVar("CURRENT_REQUEST", default=None)

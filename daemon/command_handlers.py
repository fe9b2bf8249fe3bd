"""Which method carries out which MQTT command: it says so itself, by `handles`."""

import inspect
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from traverse.daemon.errors import Result
from traverse.protocol.messages import COMMANDS, Args

Handler = Callable[[Any], Awaitable[Result]]
M = TypeVar("M", bound=Callable[..., Awaitable[Result]])

_HANDLED: dict[object, type[Args]] = {}


def handles(args: type[Args]) -> Callable[[M], M]:
    """Mark the method that carries out the command with these arguments."""

    def mark(method: M) -> M:
        _HANDLED[method] = args
        return method

    return mark


def handlers_of(*owners: object) -> dict[str, Handler]:
    """Find the handlers of all commands among the methods of some objects.

    Raises:
        TypeError: a command has none, or two.
    """
    handlers: dict[str, Handler] = {}
    for owner in owners:
        for name, function in inspect.getmembers(type(owner), inspect.isfunction):
            args = _HANDLED.get(function)
            if args is None:
                continue
            if args.command in handlers:
                raise TypeError(f"two methods carry out the command {args.command!r}")
            handlers[args.command] = getattr(owner, name)
    if missing := COMMANDS.keys() - handlers.keys():
        raise TypeError(f"no method carries out: {', '.join(sorted(missing))}")
    return handlers

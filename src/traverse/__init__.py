"""Traverse, the measurement daemon of an articulated-arm coordinate measuring machine.

What a program imports to read the points of an arm is here; everything else is in the
packages below.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from traverse.client import (
        Arm,
        BlockingArm,
        BrokerAddress,
        BrokerUnreachableError,
        ClientError,
        CommandRefused,
        Counters,
        HeldSession,
        Lost,
        NoAnswerError,
        Resent,
        ResentScan,
        StartedScan,
    )
else:

    def __getattr__(name: str) -> object:
        """Import the client when it is first used: other programs start without it."""
        if name in __all__:
            from traverse import client  # noqa: PLC0415 - see above

            return getattr(client, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Arm",
    "BlockingArm",
    "BrokerAddress",
    "BrokerUnreachableError",
    "ClientError",
    "CommandRefused",
    "Counters",
    "HeldSession",
    "Lost",
    "NoAnswerError",
    "Resent",
    "ResentScan",
    "StartedScan",
]

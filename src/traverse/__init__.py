"""Traverse, the measurement daemon of an articulated-arm coordinate measuring machine.

What a program imports to read the points of an arm is here, as `traverse.client` lists
it; everything else is in the packages below.
"""

TYPE_CHECKING = False  # as `typing` has it, whose import every command would wait for
if TYPE_CHECKING:
    from traverse import client
    from traverse.client import *  # noqa: F403 - the one list is the client's

    __all__: list[str] = []
    __all__ += client.__all__
else:

    def __getattr__(name: str) -> object:
        """Import the client when it is first used: other programs start without it."""
        # Its names; packages are not.
        if name in ("__all__", "to_pandas") or name[:1].isupper():
            from traverse import client  # noqa: PLC0415 - see above

            if name == "__all__" or name in client.__all__:
                return getattr(client, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

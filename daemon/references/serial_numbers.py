"""Which serial numbers differ, in words."""

from collections.abc import Callable, Sequence

UNKNOWN = "unknown"  # a serial number that was not reported


def new_serials(serials: Sequence[str], *, is_lost: bool) -> str:
    """Describe serial numbers of which none was confirmed, or the memory is lost."""
    lost = "; what was confirmed cannot be read" if is_lost else ""
    noun = "serial number" if len(serials) == 1 else "serial numbers"
    return f"{noun} {', '.join(_named(serials))}, never confirmed{lost}"


def changed_serials(
    before: Sequence[str], now: Sequence[str], joint_of: Callable[[int], str]
) -> str:
    """Describe what has changed between two different lists of serial numbers.

    Args:
        before: by channel; empty texts are unknown.
        now: likewise.
        joint_of: name of the joint that a channel reads.
    """
    earlier, present = _named(before), _named(now)
    if len(earlier) != len(present):
        return f"was {', '.join(earlier)}, is {', '.join(present) or UNKNOWN}"
    changes = [
        (channel, f"was {old}, is {new}")
        for channel, (old, new) in enumerate(zip(earlier, present, strict=True))
        if old != new
    ]
    if len(present) == 1:
        return changes[0][1]
    return "; ".join(f"{joint_of(channel)} {text}" for channel, text in changes)


def _named(serials: Sequence[str]) -> list[str]:
    return [serial or UNKNOWN for serial in serials]

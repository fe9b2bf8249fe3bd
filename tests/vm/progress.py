"""Waiting for emulated programs as long as they get on, however slowly."""

import asyncio
import time
from collections.abc import Callable

LOOK_S = 0.05
STALL_S = 180.0  # without any message: a program that hangs


async def until_heard(
    condition: Callable[[], object],
    what: str,
    n_messages: Callable[[], int],
    enough: int,
    least_s: float = 0.0,
) -> None:
    """Wait for a condition; fail where the programs say much and it does not hold.

    Seconds of an emulated computer say little: it may stand for many of them.

    Args:
        n_messages: of the program, which has a pace of its own.
        enough: so many further messages, and `least_s`, are waited for; without any,
            `STALL_S`.
    """
    begun_s = heard_s = time.monotonic()
    n_begun = n_last = n_messages()
    while not condition():
        now_s = time.monotonic()
        if n_messages() != n_last:
            n_last, heard_s = n_messages(), now_s
        n_heard = n_last - n_begun
        has_said_enough = n_heard > enough and now_s - begun_s > least_s
        assert not has_said_enough, f"not within {n_heard} messages: {what}"
        stalled_s = now_s - heard_s
        assert stalled_s < STALL_S, f"nothing for {stalled_s:.0f} s: {what}"
        await asyncio.sleep(LOOK_S)

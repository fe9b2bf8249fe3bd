"""Disks that fail: full, or read-only."""

import asyncio
import contextlib
import os
import subprocess
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

from benchmarks.soak.bench import ARM, Kept
from traverse.client import Arm, CommandRefused, NoAnswerError
from traverse.client.feeds import Feed
from traverse.protocol.messages import Event

SIZE_MB = 256
PATIENCE_S = 60.0


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[bool]:
    """Mount a file system of its own on a folder, where permitted."""
    folder.mkdir(parents=True, exist_ok=True)
    options = f"size={SIZE_MB}m,mode=0700"
    mounting = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    mounted = (
        os.geteuid() == 0
        and subprocess.run(mounting, capture_output=True, check=False).returncode == 0
    )
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextlib.asynccontextmanager
async def full(folder: Path) -> AsyncIterator[None]:
    filler = folder / "filler"
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(1 << 16))
    with contextlib.suppress(OSError), filler.open("ab", buffering=0) as file:
        while True:
            file.write(bytes(512))
    try:
        yield
    finally:
        filler.unlink()


@contextlib.asynccontextmanager
async def read_only(folder: Path, daemon: Kept) -> AsyncIterator[None]:
    """Make the disk read-only within the block.

    The kernel does not allow that while a file is open for writing: so the daemon is
    killed, and restarts on that disk.
    """
    daemon.kill(2.0)
    await _remount(folder, "ro")
    try:
        yield
    finally:
        await _remount(folder, "rw")


async def _remount(folder: Path, how: str) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while True:
            process = await asyncio.create_subprocess_exec(
                *("mount", "-o", f"remount,{how}", str(folder)),
                stderr=asyncio.subprocess.DEVNULL,
            )
            if await process.wait() == 0:
                return
            await asyncio.sleep(0.05)


async def refusal(
    arm: Arm, trouble: contextlib.AbstractAsyncContextManager[None]
) -> list[str]:
    """Check that points are refused with a reason, and taken again afterwards.

    Returns:
        Failures.
    """
    events = arm.events()
    faults: list[str] = []
    async with asyncio.timeout(PATIENCE_S):
        await _taken_again(arm)  # the board may have been killed a moment ago
    async with trouble:
        refused = await _first_refusal(arm)
        if refused is None:
            faults.append("points were acknowledged although nothing could be kept")
        elif refused.code != "outbox.failed":
            faults.append(f"refused with {refused.code}, expected outbox.failed")
        elif not refused.remedy:
            faults.append(f"refused without a remedy: {refused.text}")
        try:
            async with asyncio.timeout(PATIENCE_S):
                await _wait_for_event(events, active=True)
        except TimeoutError:
            faults.append("no event outbox.failed was raised")
    try:
        async with asyncio.timeout(PATIENCE_S):
            await _taken_again(arm)
            await _wait_for_event(events, active=False)
    except TimeoutError:
        faults.append("did not recover")
    return faults


async def _first_refusal(arm: Arm) -> CommandRefused | None:
    for _ in range(400):
        try:
            await arm.capture()
        except CommandRefused as error:
            return error
        except NoAnswerError:
            continue
    return None


async def _taken_again(arm: Arm) -> None:
    while True:
        try:
            await arm.capture()
        except (CommandRefused, NoAnswerError):
            await asyncio.sleep(0.1)
        else:
            return


async def _wait_for_event(events: Feed[Event], *, active: bool) -> None:
    async for event in events:
        if event.code == "outbox.failed" and event.active is active:
            return


def arm_for(port: int) -> Arm:
    return Arm(ARM, f"127.0.0.1:{port}", reply_timeout_s=5.0)

"""`python -m benchmarks.tools.staged_daemon FILE ...`: the daemon, noting instants.

Arguments of `traverse` follow FILE. Whenever a point passes one of `STAGES`
the monotonic time is noted; at the end FILE has them, a line each: stage, [ns].
"""

import functools
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.tools.command_line import run_main
from traverse.broker.client import MqttClient
from traverse.cli.__main__ import main as traverse
from traverse.daemon.points.controller import PointController
from traverse.daemon.store.durable_queue import DurableQueue
from traverse.daemon.store.recovery import ResilientDatabase
from traverse.drivers.latch_board.session import LatchBoardSession

Noted = list[tuple[str, int]]


def _edges(_session: object, latch: Any, number: int | None, *_: object) -> int:  # noqa: ANN401
    return number is not None and latch.level


def _presses(_controller: object, _device: object, latch: Any) -> int:  # noqa: ANN401
    return bool(latch.active)


def _points(_client: object, packets: bytes) -> int:
    return packets.count(b"/point")


STAGES: dict[str, tuple[type, str, Callable[..., int]]] = {
    "decoded": (LatchBoardSession, "_deliver_latch", _edges),
    "on the loop": (PointController, "take_edge", _presses),
    "encoded": (DurableQueue, "put", lambda *_: 1),
    "with the disk's thread": (ResilientDatabase, "add", lambda _, new: len(new)),
    "on the disk": (DurableQueue, "_commit", lambda _, what: len(what.numbers)),
    "sent": (MqttClient, "write", _points),
}
"""By name the method that begins, or ends, and how many points it is about."""
AFTER = ("sent",)
"""Stages whose end is noted."""


def note(noted: Noted, stage: str) -> None:
    owner, name, counts = STAGES[stage]
    method = getattr(owner, name)

    @functools.wraps(method)
    def called(*arguments: Any, **options: Any) -> Any:  # noqa: ANN401
        begun_ns, n = time.monotonic_ns(), counts(*arguments, **options)
        result = method(*arguments, **options)
        at_ns = time.monotonic_ns() if stage in AFTER else begun_ns
        noted.extend([(stage, at_ns)] * n)
        return result

    setattr(owner, name, called)


def main(path: Path, *arguments: str) -> None:
    noted: Noted = []
    for stage in STAGES:
        note(noted, stage)
    sys.argv[1:] = arguments
    try:
        traverse()
    finally:
        path.write_text("".join(f"{stage}\t{at_ns}\n" for stage, at_ns in noted))


if __name__ == "__main__":
    run_main(main)

"""Table of checks: subject, observation, and verdict."""

import json
import traceback
from collections.abc import Awaitable, Callable
from pathlib import Path

Check = Callable[[], str] | Callable[[], Awaitable[str]]


class Table:
    """Lines of checks, printed as they are made.

    Args:
        kept: a file that keeps them from program to program; None: none does.

    Attributes:
        n_failed: how many were not good.
    """

    def __init__(self, kept: Path | None = None) -> None:
        self._lines: list[str] = []
        self._kept = kept
        self.n_failed = 0
        if kept is not None and kept.exists():
            for line in kept.read_text("utf-8").splitlines():
                self._lines.append(json.loads(line)["line"])
                self.n_failed += not json.loads(line)["good"]

    async def check(self, title: str, check: Check) -> None:
        try:
            seen = check()
            result, good = seen if isinstance(seen, str) else await seen, True
        except Exception as error:  # noqa: BLE001 - the other checks shall be made too
            traceback.print_exc()
            result, good = f"{type(error).__name__}: {error}".splitlines()[0], False
        self.n_failed += not good
        line = f"{'ok' if good else 'FAILED':6s}  {title:44s}  {result}"
        self._lines.append(line)
        print(line, flush=True)  # noqa: T201 - this is the report
        if self._kept is not None:
            with self._kept.open("a", encoding="utf-8") as kept:
                kept.write(json.dumps({"line": line, "good": good}) + "\n")

    def __str__(self) -> str:
        n = len(self._lines)
        return "\n".join([*self._lines, f"{n - self.n_failed} of {n} checks are good"])

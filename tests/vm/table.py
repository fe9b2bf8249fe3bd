"""What was checked, what was seen, and whether it was good."""

import traceback
from collections.abc import Awaitable, Callable

Check = Callable[[], str] | Callable[[], Awaitable[str]]


class Table:
    """Lines of checks, printed as they are made.

    Attributes:
        n_failed: how many were not good.
    """

    def __init__(self) -> None:
        self._lines: list[str] = []
        self.n_failed = 0

    async def check(self, what: str, check: Check) -> None:
        """Make a check: it says what it saw, or raises where that is not good."""
        try:
            seen = check()
            told, good = seen if isinstance(seen, str) else await seen, True
        except Exception as error:  # noqa: BLE001 - the other checks shall be made too
            traceback.print_exc()
            told, good = f"{type(error).__name__}: {error}".splitlines()[0], False
        self.n_failed += not good
        self._lines.append(f"{'ok' if good else 'FAILED':6s}  {what:44s}  {told}")
        print(self._lines[-1], flush=True)  # noqa: T201 - this is the report

    def __str__(self) -> str:
        n = len(self._lines)
        return "\n".join([*self._lines, f"{n - self.n_failed} of {n} checks are good"])

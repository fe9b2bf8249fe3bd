"""The database of a group of members: used in a thread, and sometimes away."""

import asyncio
from collections.abc import Callable
from typing import Concatenate, ParamSpec, TypeVar

from traverse.fleet.database import Database

P = ParamSpec("P")
T = TypeVar("T")


class QueryThread:
    """Runs functions of a database in a thread, one at a time."""

    def __init__(self, database: Database) -> None:
        self.database = database
        self._lock = asyncio.Lock()

    async def run(
        self,
        function: Callable[Concatenate[Database, P], T],
        *arguments: P.args,
        **options: P.kwargs,
    ) -> T:
        async with self._lock:
            return await asyncio.to_thread(
                function, self.database, *arguments, **options
            )


class Outage:
    """Reports once that a database is away, and once that it is back."""

    def __init__(self, name: str, report: Callable[[str], None]) -> None:
        self._name = name
        self._report = report
        self._is_away = False

    def begin(self, reason: str) -> None:
        if not self._is_away:
            self._report(f"{reason}; messages wait at the broker, and this tries again")
        self._is_away = True

    def end(self) -> None:
        if self._is_away:
            self._report(f"{self._name} is back")
        self._is_away = False

"""A member's name in its group: held by one process at a time.

The database keeps who holds it; a broker that ends connections shows it, too.
"""

import asyncio
import contextlib
import time
import uuid
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from traverse.fleet.database import StoreAwayError
from traverse.fleet.gaps import take_lease
from traverse.fleet.query_thread import Outage, QueryThread

RETRY_S = 1.0
LOSSES, LOSSES_S = 6, 10.0
"""So many lost connections in so short a time: two members have one name."""
NAME_LEASE_S, RENEWAL_S = 6.0, 2.0
"""A member that has ended without a word is known to have done so after this time."""


class NameTakenError(Exception):
    """Another member of the group has the same name."""


@dataclass(slots=True)
class NameConflict:
    """Notices by lost connections that two members have one name.

    Not every broker tells that another client has the identifier: it ends a connection
    whenever the other one connects. The one that had been connected for long stays for
    twice as many losses, so that the other one ends.
    """

    connected_s: float
    _most: int = LOSSES
    _lost_s: deque[float] = field(default_factory=lambda: deque(maxlen=2 * LOSSES))

    def shows(self, lost_s: float) -> bool:
        """Count a lost connection; return whether there are too many."""
        if lost_s - self.connected_s >= LOSSES_S:
            self._most = 2 * LOSSES
        self._lost_s.append(lost_s)
        n_recent = sum(lost_s - earlier_s < LOSSES_S for earlier_s in self._lost_s)
        return n_recent >= self._most


class NameClaim:
    """A process's claim on a member's name.

    Args:
        queries: of the group's database.
        outage: told when the database is away, and when it is back.
        report: called with sentences for people.
    """

    def __init__(
        self,
        group: str,
        member: str,
        queries: QueryThread,
        outage: Outage,
        report: Callable[[str], None],
    ) -> None:
        self._member = member
        self._lease = f"name {group}/{member}"
        self._process = uuid.uuid4().hex
        self._queries = queries
        self._outage = outage
        self._report = report

    async def claim(self) -> None:
        """Claim the name.

        A killed member leaves its claim behind, so this waits whether the claim is
        renewed, which is impossible while the database is away.

        Raises:
            NameTakenError: another process holds it.
        """
        loop = asyncio.get_running_loop()
        until_s = loop.time() + NAME_LEASE_S + RENEWAL_S
        is_reported = False
        while True:
            try:
                if await self._renew():
                    self._outage.end()
                    return
            except StoreAwayError as error:
                self._outage.begin(str(error))
                until_s = loop.time() + NAME_LEASE_S + RENEWAL_S
                await asyncio.sleep(RETRY_S)
                continue
            if loop.time() > until_s:
                raise NameTakenError
            if not is_reported:
                self._report(
                    f"a member called {self._member} is there, or has ended "
                    f"without a word; waiting up to {NAME_LEASE_S + RENEWAL_S:g} s "
                    "for it"
                )
            is_reported = True
            await asyncio.sleep(RETRY_S)

    async def keep(self) -> None:
        """Renew the claim until cancelled.

        Raises:
            NameTakenError: another process holds the name.
        """
        while True:
            await asyncio.sleep(RENEWAL_S)
            with contextlib.suppress(StoreAwayError):  # writing reports that
                if not await self._renew():
                    raise NameTakenError

    def release(self) -> None:
        """Release the name for another process; call it when nothing runs any more."""
        with contextlib.suppress(StoreAwayError):
            database = self._queries.database
            take_lease(database, self._lease, self._process, time.time_ns(), 0)

    async def _renew(self) -> bool:
        lease_ns = int(NAME_LEASE_S * 1e9)
        return await self._queries.run(
            take_lease, self._lease, self._process, time.time_ns(), lease_ns
        )

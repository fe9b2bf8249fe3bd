"""Faults of the soak test, one after the other and at once."""

import asyncio
import random
from collections import Counter
from collections.abc import Awaitable, Callable

from benchmarks.soak.bench import Bench, Kept
from benchmarks.tools.network import Network

KINDS = (
    *("daemon", "broker", "board", "network"),
    *("consumers_network", "consumer", "witness"),
)
WEIGHTS = (4, 3, 3, 3, 2, 2, 1)


class Outages:
    """Kills programs and cuts networks at random moments.

    Args:
        seed: of the moments and kinds.
        pause_s: between two, at least and at most.
    """

    def __init__(
        self, bench: Bench, seed: int, pause_s: tuple[float, float] = (1.0, 10.0)
    ) -> None:
        self._bench = bench
        self._chance = random.Random(seed)
        self._pause_s = pause_s
        self._running: set[asyncio.Future[None]] = set()
        self.counts: Counter[str] = Counter()

    async def happen(self, n: int, report: Callable[[str], None]) -> None:
        while (done := sum(self.counts.values())) < n:
            await asyncio.sleep(self._chance.uniform(*self._pause_s))
            kind = self._chance.choices(KINDS, WEIGHTS)[0]
            work = self._outage(kind)
            if work is None:
                continue  # it is down already
            self.counts[kind] += 1
            task = asyncio.ensure_future(work)
            self._running.add(task)
            task.add_done_callback(self._running.discard)
            report(f"{done + 1:4d} {kind}")
        await asyncio.gather(*self._running)

    def _outage(self, kind: str) -> Awaitable[None] | None:
        bench = self._bench
        down_s = self._chance.choice((0.0, 0.2, 1.0, 4.0))
        if kind.endswith("network"):
            is_daemons = kind == "network"
            network = bench.daemons_network if is_daemons else bench.consumers_network
            return self._fail(network, down_s)
        victim = {
            "daemon": bench.daemon,
            "broker": bench.broker,
            "board": bench.board,
            "consumer": bench.consumer,
            "witness": bench.witness,
        }[kind]
        return self._kill(victim, down_s) if victim.is_running else None

    async def _kill(self, victim: Kept, down_s: float) -> None:
        victim.kill(down_s)

    async def _fail(self, network: Network, down_s: float) -> None:
        how = self._chance.choice(("cut", "refuse", "swallow"))
        if how == "swallow":
            network.swallow()
            await asyncio.sleep(2 * down_s)
        elif how == "refuse":
            network.refuse()
            await network.cut()
            await asyncio.sleep(down_s)
        else:
            await network.cut()
        network.pass_on()

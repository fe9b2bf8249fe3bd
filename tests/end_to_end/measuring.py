"""A whole arm at work, for the length of a block."""

import contextlib
from collections.abc import AsyncIterator

from benchmarks.tools.network import Network
from tests.end_to_end.listener import Listener, listening
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench


@contextlib.asynccontextmanager
async def measuring(
    bench: Workbench, state: str | None = "ready"
) -> AsyncIterator[tuple[Listener, Program, Program]]:
    """Simulator and daemon as configured, and a listener.

    The script begins when the daemon first starts a stream: nothing is missed. Both
    programs must end in order, those that the test itself has ended excepted.
    """
    async with listening(bench.host, bench.port, bench.arm) as listener:
        with bench.simulator() as simulator:
            await simulator.says("ready base")
            with bench.daemon() as daemon:
                await listener.ready(state)
                yield listener, simulator, daemon
                await _end(daemon)
            await _end(simulator)


@contextlib.asynccontextmanager
async def measuring_over(
    network: Network, bench: Workbench
) -> AsyncIterator[tuple[Listener, Program, Program]]:
    """As `measuring`, but the daemon reaches the broker by a network alone."""
    direct, bench.port = bench.port, network.port
    bench.write_daemon()
    bench.port = direct
    async with measuring(bench) as measured:
        yield measured


async def _end(program: Program) -> None:
    if program.process.poll() is None:
        assert await program.stop() == 0, f"{program.name} did not end in order"

"""`python -m benchmarks.service.idle`: cost of an unused daemon.

Its board streams as always, nobody presses, and mosquitto is connected.
"""

import os
import statistics
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.presses import NEVER_HZ, Spent, edge_board
from benchmarks.tools.rounds import load

ROUNDS = 5
SECONDS = 6.0
SETTLE_S = 5.0  # the board presses once, after a second; then the arm has to rest


@dataclass(frozen=True, slots=True)
class Idle:
    """One round; shares are of one core.

    Attributes:
        moves: the arm moves; else it rests.
        threads_share: of each thread of the daemon, in the order of their start.
        switches_hz: their voluntary switches, in the same order.
    """

    moves: bool
    daemon_share: float
    board_share: float
    threads_share: list[float]
    switches_hz: list[float]
    memory_mb: float

    def line(self) -> str:
        threads = ", ".join(
            f"{share:.2%} ({switches:.0f}/s)"
            for share, switches in zip(
                self.threads_share, self.switches_hz, strict=True
            )
            if switches
        )
        return (
            f"idle, the arm {'moves' if self.moves else 'rests'}: daemon "
            f"{self.daemon_share:.2%} of a core, board {self.board_share:.2%}; threads "
            f"(their voluntary switches) {threads}; {self.memory_mb:.0f} MB"
        )


def switches(pid: int) -> list[int]:
    """Voluntary context switches of each thread, in the order of their start."""
    folder = Path(f"/proc/{pid}/task")
    return [
        int((folder / number / "status").read_text("ascii").split()[-3])
        for number in sorted(os.listdir(folder), key=int)
    ]


def idle(folder: Path, seconds: float, *, moves: bool) -> Idle:
    port = rig.free_port()
    with rig.mosquitto(folder, port), ExitStack() as stack:
        if moves:
            board = stack.enter_context(rig.simulator(folder))
        else:
            _, board = stack.enter_context(edge_board(folder, NEVER_HZ))
        process = stack.enter_context(rig.daemon(folder, port))
        time.sleep(SETTLE_S)
        before, n = Spent.by(process.pid), switches(process.pid)
        board_before, begun_s = Spent.by(board.pid), time.monotonic()
        time.sleep(seconds)
        elapsed_s = time.monotonic() - begun_s
        spent, n_after = Spent.by(process.pid).since(before), switches(process.pid)
        of_board_ns = sum(Spent.by(board.pid).since(board_before).cpu_ns)
        shares = [cpu_ns * 1e-9 / elapsed_s for cpu_ns in spent.cpu_ns]
        return Idle(
            moves,
            sum(shares),
            of_board_ns * 1e-9 / elapsed_s,
            shares,
            [(b - a) / elapsed_s for a, b in zip(n, n_after, strict=True)],
            rig.rss_mb(process),
        )


def main() -> None:
    print(load())
    for moves in (False, True):
        runs = []
        for _ in range(ROUNDS):
            with tempfile.TemporaryDirectory() as folder:
                runs.append(idle(Path(folder), SECONDS, moves=moves))
            print(runs[-1].line(), flush=True)
        shares = [run.daemon_share for run in runs]
        print(
            f"{statistics.median(shares):.2%} ({min(shares):.2%} to {max(shares):.2%})"
        )
    print(load())


if __name__ == "__main__":
    run_main(main)

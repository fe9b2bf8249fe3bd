"""A board that presses its button, and a program's CPU time for its points."""

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.tools import rig
from benchmarks.tools.edge_board import COUNTS

ARM = "demo-7"
NEVER_HZ = 1e-4


@contextlib.contextmanager
def edge_board(
    folder: Path, *rates: object
) -> Iterator[tuple[Path, "subprocess.Popen[bytes]"]]:
    """Run a board that presses; gives the file to which it writes press times, and it.

    Rates are as in `benchmarks.tools.edge_board`.

    Points that a program kept of an earlier board are not sent again.
    """
    shutil.rmtree(folder / "state", ignore_errors=True)
    shutil.copy(rig.ARM, folder / "arm.toml")
    run = (sys.executable, "-m", "benchmarks.tools.edge_board")
    log = folder / "presses.log"
    log.unlink(missing_ok=True)
    arguments = str(folder / "board.pty"), *map(str, rates)
    with rig.program(log, *run, *arguments) as board:
        rig.wait_for((folder / "board.pty").exists, "the board")
        yield log, board


@dataclass(frozen=True, slots=True)
class Spent:
    """Resources that a program has used, or used between two moments."""

    cpu_ns: tuple[int, ...]
    switches: int

    @classmethod
    def by(cls, pid: int) -> "Spent":
        folder, cpu_ns, switches = Path(f"/proc/{pid}/task"), [], 0
        for number in sorted(os.listdir(folder), key=int):
            words = (folder / number / "schedstat").read_text("ascii").split()
            cpu_ns.append(int(words[0]))
            switches += int(words[2])
        return cls(tuple(cpu_ns), switches)

    def since(self, before: "Spent") -> "Spent":
        """Subtract earlier times; later threads had spent nothing."""
        begun_ns = before.cpu_ns + (0,) * (len(self.cpu_ns) - len(before.cpu_ns))
        spent_ns = tuple(
            now - earlier for now, earlier in zip(self.cpu_ns, begun_ns, strict=True)
        )
        return Spent(spent_ns, self.switches - before.switches)


def figures(values_ns: Sequence[int]) -> dict[str, float]:
    p50, p99, largest = np.percentile(values_ns, [50, 99, 100]) * 1e-3
    return {"p50_us": p50, "p99_us": p99, "largest_us": largest}


def press_of(counts: Sequence[int]) -> int:
    return counts[0] - int(COUNTS[0])

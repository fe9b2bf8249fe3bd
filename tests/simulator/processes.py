"""The simulator as its users meet it: a process that reports when it is ready."""

import subprocess
import sys
from contextlib import contextmanager

PROGRAM = "import sys; from traverse.simulator.run import run_simulator; "
PROGRAM += "sys.exit(run_simulator(sys.argv[1]))"
SPHERE = """
[[motion]]
kind = "sphere"
centre_mm = [500.0, 100.0, 50.0]
radius_mm = 25.4
points = 3
"""


@contextmanager
def simulator(folder, text, ports=("port/base",)):
    """One with this configuration, ready with the ports of its device `base`."""
    (folder / "sim.toml").write_text(text)
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(folder / "sim.toml")],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            where = " ".join(str(folder / port) for port in ports)
            assert process.stdout.readline() == f"ready base {where}\n"
            yield process
        finally:
            process.kill()

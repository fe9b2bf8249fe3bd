"""`python -m benchmarks.clients.typed FOLDER`: a picture of typed points for docs/.

A real broker, a simulated arm with its daemon, `traverse gateway keys`, an X server
and xterm with a program that takes text: typed-points.png is what is seen.
"""

import contextlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from benchmarks.clients.screenshots import simulated
from benchmarks.tools import rig
from tests.client.gateways.desktop import SIZE, desktop

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
POINTS = 8


def main(folder: Path, out: Path) -> None:
    """Measure until so many points are typed."""
    port = rig.free_port()
    shutil.copy(ARM, folder)
    run = (sys.executable, "-m", "traverse", "gateway", "keys", "--arm", "demo-7")
    with (
        rig.mosquitto(folder, port),
        simulated(folder),
        rig.daemon(folder, port),
        desktop(folder) as shown,
    ):
        os.environ["DISPLAY"] = shown.name
        with rig.program(folder / "keys.log", *run, "--broker", f"127.0.0.1:{port}"):
            rig.wait_for(
                lambda: shown.typed.count("\n") >= POINTS, "typed points", 120.0
            )
        width, height = SIZE
        pixels = np.frombuffer(shown.picture(), np.uint8).reshape(height, width, 4)
        imsave(out / "typed-points.png", np.ascontiguousarray(pixels[:, :, 2::-1]))


if __name__ == "__main__":
    OUT = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        main(Path(), OUT)

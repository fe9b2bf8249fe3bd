"""`make bench`: the figures of docs/performance.md."""

import os
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.decoder import corrupted, noise, speed
from benchmarks.latency import latency
from benchmarks.stream import stream

SECONDS = 60.0


def main(seconds: float) -> None:
    """Print every figure, and how busy the machine was meanwhile."""
    busy = os.getloadavg()[0]
    begun_s = time.monotonic()
    print(f"load of the machine before: {busy:.2f}, cores: {os.cpu_count()}")
    for rate_hz in (1000.0, 10_000.0):
        with tempfile.TemporaryDirectory() as folder:
            print(stream(Path(folder), rate_hz, seconds), flush=True)
    with tempfile.TemporaryDirectory() as folder:
        print("\n".join(latency(Path(folder))), flush=True)
    print(noise())
    print(corrupted())
    print(speed())
    taken_s = time.monotonic() - begun_s
    print(f"load after: {os.getloadavg()[0]:.2f}; took {taken_s:.0f} s")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS)

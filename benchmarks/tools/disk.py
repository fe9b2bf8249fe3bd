"""Times of the disk alone, the bar beside which points are measured."""

import os
import time
from pathlib import Path

BAR_BYTES = 4096
N_SYNCS = 200


def syncs_ns(folder: Path, rate_hz: float) -> list[int]:
    """Write 4 KiB and sync them, so many times a second; how long each took."""
    path, times_ns = folder / "disk-bar", []
    with path.open("wb", buffering=0) as file:
        due_s = time.monotonic()
        for _ in range(N_SYNCS):
            due_s += 1.0 / rate_hz
            time.sleep(max(0.0, due_s - time.monotonic()))
            begun_ns = time.monotonic_ns()
            file.write(bytes(BAR_BYTES))
            os.fdatasync(file.fileno())
            times_ns.append(time.monotonic_ns() - begun_ns)
    path.unlink()
    return times_ns
